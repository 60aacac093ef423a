"""A body as points and lines."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.pipeline.bodies import cells_of, wireframe
from cmsreduce.pipeline.bodies.wireframe import _coupled_groups, _thinned
from tests.frames import line

BODY = line("bar", [0, 0, 0], [1.5, 0, 0], 30)


def test_lines_are_the_elements() -> None:
    ids = BODY.nodes.id
    cells = {"line": np.column_stack([ids[:-1], ids[1:]])}
    found = wireframe(BODY, cells)
    assert found.meshed
    assert (len(found.node), len(found.lines), found.left_out) == (31, 30, 0)
    np.testing.assert_allclose(np.linalg.norm(np.diff(found.xyz[found.lines], axis=1), axis=2), 0.05)


def test_without_elements_lines_join_what_the_stiffness_couples() -> None:
    found = wireframe(BODY, {})
    assert not found.meshed
    assert len(found.lines) == 30


def test_of_a_crowd_the_shortest_lines_are_drawn() -> None:
    """A condensed body couples every node with every other one."""
    full = replace(BODY, K=BODY.K + 1e-3 * np.ones(BODY.K.shape))
    found = wireframe(full, {})
    assert len(found.lines) == 30
    np.testing.assert_allclose(np.linalg.norm(np.diff(found.xyz[found.lines], axis=1), axis=2), 0.05)


def test_pairs_are_those_between_which_there_is_an_entry_even_a_zero() -> None:
    A = sp.csc_array(np.array([[4.0, 1.0, 0.0, 2.0], [1.0, 4.0, 3.0, 0.0], [0.0, 3.0, 4.0, 5.0], [2.0, 0.0, 5.0, 4.0]]))
    A.data[A.data == 3.0] = 0.0
    # Row 3 belongs to no group.
    np.testing.assert_array_equal(_coupled_groups(A, np.array([2, 0, 1, -1]), 3), [[0, 1], [0, 2]])
    assert _coupled_groups(A, np.array([0, 0, 0, -1]), 1).shape == (0, 2)


@pytest.mark.parametrize("most", [20, 10, 5])
def test_large_meshes_are_thinned(most: int) -> None:
    found = wireframe(BODY, {}, most)
    assert found.node.size + found.left_out == 31
    assert most / 3 <= found.node.size <= most
    # What is drawn still hangs together, from the first interface to the last.
    assert {int(n) for face in BODY.interfaces.values() for n in face.node} <= set(found.node.tolist())
    assert len(found.lines) >= found.node.size - 1


def test_nodes_at_one_place_are_drawn_as_one() -> None:
    """No cube of space tells them apart, however small it is."""
    drawn_by = _thinned(np.repeat(BODY.nodes.xyz, 2, axis=0), np.zeros(62, dtype=bool), 40)
    np.testing.assert_array_equal(drawn_by, 2 * np.arange(31).repeat(2))


def test_no_geometry() -> None:
    assert cells_of(replace(BODY, nodes=None, interfaces={})) == {}
    assert wireframe(replace(BODY, nodes=None, interfaces={}), {}) is None
