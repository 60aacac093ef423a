"""Dof tables, nodes and rigid-body shapes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, Nodes, components_from_digits, cross_matrix, rigid_body_shapes
from tests.frames import rotation


def test_rows_are_found_in_any_order():
    table = DofTable([30, 10, 10, 20], [1, 6, 1, 0])
    assert len(table) == 4
    assert table.rows([10, 10, 20, 30, 99], [1, 6, 0, 1, 1]).tolist() == [2, 1, 3, 0, -1]
    assert table.rows(10, [1, 2, 6]).tolist() == [2, -1, 1]
    assert table.labels == ["30.1", "10.6", "10.1", "20.0"]
    assert DofTable([], []).rows(1, [1, 2]).tolist() == [-1, -1]


@pytest.mark.parametrize(
    ("node", "component", "message"),
    [
        ([1, 1], [2, 2], r"dof 1\.2 is in two rows, 1 and 2"),
        ([1, 5], [1, 7], r"row 2: component 7 of node 5 is not 0\.\.6"),
        ([1, 2], [1], "one component for each node"),
    ],
)
def test_tables_refused(node, component, message):
    with pytest.raises(DofMapError, match=message):
        DofTable(np.array(node), np.array(component))


def test_missing_dofs_are_named():
    table = DofTable([4, 4, 4], [1, 2, 3])
    assert table.rows_of(4, (3, 1)).tolist() == [2, 0]
    with pytest.raises(DofMapError, match="node 4 has no dof 46 in the matrices: it has 123"):
        table.rows_of(4, (1, 4, 6))
    with pytest.raises(DofMapError, match=r"node 5 has no dof 1 .*no such node"):
        table.rows_of(5, (1,))


@pytest.mark.parametrize("digits", ["", "7", "12a", 0, "1 2"])
def test_digits_refused(digits):
    with pytest.raises(DofMapError):
        components_from_digits(digits)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": [1, 1]}, "node 1 is defined twice"),
        ({"xyz": [[0, 0, 0], [0, np.nan, 0]]}, "node 2 has a coordinate that is not a number"),
        ({"frame": np.array([np.eye(3), np.diag([1, 1, 1.1])])}, "node 2: .* not orthonormal"),
        ({"xyz": [[0, 0, 0]]}, "2 nodes need"),
    ],
)
def test_nodes_refused(change, message):
    given = {"id": [1, 2], "xyz": np.zeros((2, 3)), "frame": np.tile(np.eye(3), (2, 1, 1))} | change
    with pytest.raises(DofMapError, match=message):
        Nodes(**given)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(seed=st.integers(0, 10**6))
def test_rigid_shapes_are_the_velocities_of_a_rigid_body(seed):
    """u = v + w x (x - about), along each node's own axes."""
    rng = np.random.default_rng(seed)
    xyz, about = rng.uniform(-3, 3, (4, 3)), rng.uniform(-1, 1, 3)
    frames = np.array([rotation(rng.standard_normal(3), rng.uniform(0, 6)) for _ in range(4)])
    nodes = Nodes(np.array([5, 2, 9, 7]), xyz, frames)
    dofs = DofTable(np.repeat([9, 5, 7], 6), np.tile([4, 1, 6, 3, 2, 5], 3))
    v, w = rng.standard_normal(3), rng.standard_normal(3)
    u = rigid_body_shapes(dofs, nodes, about) @ np.r_[v, w]
    for row, (node, component) in enumerate(zip(dofs.node, dofs.component, strict=True)):
        k = [5, 2, 9, 7].index(node)
        moved = v + np.cross(w, xyz[k] - about) if component <= 3 else w
        assert u[row] == pytest.approx(frames[k][(component - 1) % 3] @ moved, abs=1e-12)


def test_scalar_dofs_do_not_move_rigidly():
    nodes = Nodes.in_basic([1], [[1, 2, 3]])
    R = rigid_body_shapes(DofTable([1, 100], [2, 0]), nodes)
    np.testing.assert_array_equal(R, [[0, 1, 0, -3, 0, 1], [0, 0, 0, 0, 0, 0]])
    with pytest.raises(DofMapError, match="node 8 has rows"):
        rigid_body_shapes(DofTable([8], [1]), nodes)


def test_cross_matrix():
    r, v = np.array([[1.0, -2, 3], [0, 1, 5]]), np.array([4.0, 5, -6])
    np.testing.assert_array_equal(cross_matrix(r) @ v, np.cross(r, v))
