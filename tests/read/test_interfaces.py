"""Interfaces resolved into nodes, components, positions and axes, or refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cmsreduce.errors import SceneError
from cmsreduce.model import DofTable, FEModel, Interface, Nodes
from cmsreduce.read import InterfaceSpec, Nearby
from cmsreduce.read.interfaces import resolve_interface

TURNED = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
# Node 3 has no rotation about x, 55 is in the geometry only, 900 is a scalar point.
DOFS = DofTable(
    np.array([3, 3, 3, 7, 7, 7, 7, 900]),
    np.array([1, 2, 5, 1, 2, 3, 6, 0]),
)
NODES = Nodes(
    np.array([3, 7, 55]), np.array([[0.0, 0, 0], [1, 2, 3], [0, 0, 2]]), np.array([np.eye(3), TURNED, np.eye(3)])
)
SETS = {"b": np.array([3, 4, 0, 1]), "q": np.array([7])}


def resolve(spec: InterfaceSpec, nodes: Nodes | None = NODES) -> Interface:
    return resolve_interface("boom", "root", spec, DOFS, nodes, SETS)


@pytest.mark.parametrize(
    ("spec", "nodes", "components"),
    [
        (InterfaceSpec(nodes=(7,)), [7], ((1, 2, 3, 6),)),
        (InterfaceSpec(nodes=(7, 3)), [7, 3], ((1, 2, 3, 6), (1, 2, 5))),
        (InterfaceSpec(nodes=(7, 3), dofs="21"), [7, 3], ((1, 2), (1, 2))),
        (InterfaceSpec(nodes=(7,), dofs=(3, 1)), [7], ((1, 3),)),
        (InterfaceSpec(set="b"), [7, 3], ((1, 2), (1, 2))),
        (InterfaceSpec(set="b", dofs="2"), [7, 3], ((2,), (2,))),
    ],
)
def test_nodes_and_components(spec: InterfaceSpec, nodes: list[int], components: tuple[tuple[int, ...], ...]) -> None:
    face = resolve(spec)
    assert face.node.tolist() == nodes
    assert face.components == components
    np.testing.assert_array_equal(face.position, NODES.xyz[NODES.index(nodes)])


def test_the_frame_is_the_first_node_s_or_the_user_s() -> None:
    np.testing.assert_array_equal(resolve(InterfaceSpec(nodes=(7, 3))).frame, TURNED)
    own = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    face = resolve(InterfaceSpec(nodes=(3, 7), frame=5 * own))
    np.testing.assert_allclose(face.frame, own, atol=1e-15)
    # Components stay along the nodes' own axes whatever the axes of the joint.
    np.testing.assert_array_equal(face.node_frame(0), np.eye(3))
    np.testing.assert_array_equal(face.node_frame(1), TURNED)
    typed = np.array([[0.7071, 0.7071, 0], [-0.7071, 0.7071, 0], [0, 0, 1]])
    frame = resolve(InterfaceSpec(nodes=(7,), frame=typed)).frame
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    np.testing.assert_array_equal(resolve(InterfaceSpec(nodes=(7,)), nodes=None).frame, np.eye(3))


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        (InterfaceSpec(nodes=(8,)), r"no node 8; the matrices have 2 nodes, from 3 to 7, the nearest ids are 7, 3"),
        (InterfaceSpec(nodes=(55,)), r"node 55 is in the geometry but has no rows .*such as 3 \(2 away\), 7 "),
        (InterfaceSpec(nodes=(900,)), "900 is a scalar point"),
        (InterfaceSpec(nodes=(3,), dofs="123"), "node 3 has no dof 3 in the matrices, it has 125"),
        (InterfaceSpec(nodes=(3,), dofs="17"), "'17' names no dofs"),
        (InterfaceSpec(set="c"), r"no set 'c' \(dof sets: b \(4\), q \(1\); sets of nodes: none\)"),
        (InterfaceSpec(set="q"), "set 'q' holds scalar dofs only"),
        (InterfaceSpec(set="b", dofs="3"), "node 7 has no dof 3 in set 'b'"),
        (InterfaceSpec(), "either `node:`"),
        (InterfaceSpec(nodes=(3,), set="b"), "either `node:`"),
        (InterfaceSpec(nodes=()), "it has no nodes"),
        (InterfaceSpec(nodes=(3, 7, 3)), "node 3 is named twice"),
        (InterfaceSpec(nodes=(3,), frame=np.diag([1.0, 1, -1])), "not a right-handed set"),
        (InterfaceSpec(nodes=(3,), frame=np.ones((3, 3))), "not a right-handed set"),
        (InterfaceSpec(nodes=(3,), frame=np.zeros((3, 3))), "an axis of `frame:` is zero"),
        (InterfaceSpec(nodes=(3,), frame=np.eye(2)), "three axes of three numbers"),
    ],
)
def test_what_cannot_be_an_interface_is_refused(spec: InterfaceSpec, message: str) -> None:
    with pytest.raises(SceneError, match=rf"body 'boom', interface 'root': .*{message}"):
        resolve(spec)


def test_rows_of_an_interface_follow_its_nodes(space_frame: Callable[..., FEModel]) -> None:
    body = space_frame()
    face = resolve_interface("frame", "root", InterfaceSpec(nodes=(40, 3), dofs="13"), body.dofs, body.nodes, {})
    rows = space_frame(interfaces={"root": face}).interface_rows("root")
    assert [body.dofs.labels[row] for row in rows] == ["40.1", "40.3", "3.1", "3.3"]


# A line of nodes along z and two beside it; node 6 has no rows.
ROW = DofTable(np.repeat([9, 4, 2, 8, 5], 3), np.tile([1, 2, 3], 5))
LINE = Nodes.in_basic(
    np.array([9, 4, 2, 8, 5, 6]),
    np.array([[0.0, 0, 0.2], [0, 0, 0.1], [0, 0, 0], [0.003, 0, 0.1], [0, 0.003, 0.1], [0, 0, 0.1]]),
)


def near(*position: float, within: float, nearest: bool = False) -> list[int]:
    spec = InterfaceSpec(near=Nearby(position, within, nearest))  # type: ignore[arg-type]
    return resolve_interface("boom", "root", spec, ROW, LINE, {}).node.tolist()


def test_nodes_by_position_are_ordered_along_x_y_z() -> None:
    assert near(0, 0, 0.1, within=0.004) == [4, 5, 8]
    assert near(0, 0, 0.1, within=1.0) == [2, 4, 9, 5, 8]
    assert near(0, 0, 0.101, within=0.004, nearest=True) == [4]


@pytest.mark.parametrize(
    ("position", "within", "message"),
    [
        (
            (0, 0, 0.15),
            0.01,
            r"no node with rows lies within 0\.01 of \[0, 0, 0\.15\]; .* \(0\.05 away\)",
        ),
        ((0, 0, 100.0), 2.0, r"reaches from \[0, 0, 0\] to \[0\.003, 0\.003, 0\.2\] in its own unit of length"),
        ((0, 0, 1000.0), 2.0, r"basic frame, and in its units\?$"),
    ],
)
def test_positions_without_nodes(position: tuple[float, ...], within: float, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        near(*position, within=within)


def test_two_nodes_that_are_equally_near() -> None:
    with pytest.raises(SceneError, match="are equally near"):
        near(0.003, 0.003, 0.1, within=0.0035, nearest=True)
    with pytest.raises(SceneError, match="`near:` needs coordinates"):
        resolve_interface("boom", "root", InterfaceSpec(near=Nearby((0, 0, 0), 1.0)), ROW, None, {})


def test_sets_of_nodes() -> None:
    """Capitals do not matter; nodes that a node of a shell became stand for it; a dof set of the same name wins."""
    named = {"HUB": np.array([7, 40]), "Two": np.array([3]), "two": np.array([7]), "b": np.array([55])}
    for name, nodes in (("hub", [7, 3]), ("Two", [3]), ("b", [7, 3])):
        found = resolve_interface("boom", "root", InterfaceSpec(set=name), DOFS, NODES, SETS, named, {40: (2, 3)})
        assert found.node.tolist() == nodes
    with pytest.raises(SceneError, match=r"no set 'TWO' \(dof sets: b \(4\), q \(1\); sets of nodes: HUB \(2\), "):
        resolve_interface("boom", "root", InterfaceSpec(set="TWO"), DOFS, NODES, SETS, named)
