"""Rows beside supports whose order no force shows, and rows of held bodies that look like those beside supports."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel
from cmsreduce.read import prove_row_order
from tests.frames import frame
from tests.solids import block, face

CELLS = (6, 2, 2)


def without(body: FEModel, gone: np.ndarray) -> FEModel:
    """Body with some rows (n,) held."""
    kept = np.flatnonzero(~gone)
    K, M = (sp.csc_array(A[kept][:, kept]) for A in (body.K, body.M))
    held = body.dofs[np.flatnonzero(gone)]
    return replace(body, K=K, M=M, dofs=body.dofs[kept], constrained=held, grounded=False)


def permuted(body: FEModel, order: np.ndarray) -> FEModel:
    return replace(body, K=sp.csc_array(body.K[order][:, order]), M=sp.csc_array(body.M[order][:, order]))


def clamped() -> FEModel:
    body = block("part", [1.5, 0.5, 0.75], CELLS)
    return without(body, np.isin(body.dofs.node, face(CELLS, 0)))


def arm() -> FEModel:
    body = frame("part", [[0.1 * i, 0.002 * i * i, 0] for i in range(10)], [(i, i + 1) for i in range(1, 10)])
    return without(body, body.dofs.node == 1)


def of_second_order() -> FEModel:
    """Bricks of one and of two steps on one another: nodes in the middle of a step couple the layers beside alone."""
    fine, coarse = block("part", [1.5, 0.5, 0.75], CELLS), block("part", [1.5, 0.5, 0.75], (CELLS[0] // 2, 2, 2))
    layer, rest = (coarse.dofs.node - 1) // 9, (coarse.dofs.node - 1) % 9
    rows = np.array(
        [fine.dofs.rows(n, [c])[0] for n, c in zip(18 * layer + rest + 1, coarse.dofs.component, strict=True)]
    )
    T = sp.csr_array((np.ones(coarse.n), (rows, np.arange(coarse.n))), shape=(fine.n, coarse.n))
    body = replace(fine, K=sp.csc_array(fine.K + T @ coarse.K @ T.T), M=sp.csc_array(fine.M + T @ coarse.M @ T.T))
    return without(body, np.isin(body.dofs.node, face(CELLS, 0)))


@pytest.mark.parametrize("body", [clamped(), arm()], ids=["block", "arm"])
def test_nodes_beside_supports_are_shown_by_those_behind(body: FEModel) -> None:
    proof = prove_row_order(body)
    assert (proof.status, proof.hidden.only) == ("proven", "")


def test_a_layer_that_couples_nodes_beside_supports_alone_is_named() -> None:
    """Nodes 10 to 18 are in the middle of the elements at the supports; in their order, or another."""
    body = of_second_order()
    for a, b in [(10, 10), *combinations(face(CELLS, 1), 2)]:
        order = np.arange(body.n)
        order[body.dofs.node == a], order[body.dofs.node == b] = (
            np.flatnonzero(body.dofs.node == b),
            np.flatnonzero(body.dofs.node == a),
        )
        proof = prove_row_order(permuted(body, order))
        assert proof.status == "proven" and np.isin(np.arange(27), proof.hidden.rows).all()
        assert proof.hidden.remark.startswith("27 rows (10.1, 10.2, 10.3, 11.1, 11.2 ...) beside the ground")


@pytest.mark.parametrize("body", [clamped(), arm()], ids=["block", "arm"])
def test_reversed_nodes_leave_the_supports_at_the_wrong_end(body: FEModel) -> None:
    """K resists translation at the other end; it was proven whole."""
    ids = body.dofs.node_ids
    order = np.concatenate([np.flatnonzero(body.dofs.node == k) for k in ids[::-1]])
    try:
        proof = prove_row_order(permuted(body, order))
    except DofMapError:
        return
    assert proof.status == "grounded" and "no node beside a support that the files state resists" in proof.remark


@pytest.mark.parametrize(("one", "other"), [(1, 2), (1, 3), (2, 3)])
def test_rows_of_one_node_exchanged_look_like_a_support(one: int, other: int) -> None:
    """In both matrices: the node and its neighbours resist translation, and it was proven whole."""
    body = arm()
    order, rows = np.arange(body.n), body.dofs.rows([6, 6], [one, other])
    order[rows] = rows[::-1]
    try:
        proof = prove_row_order(permuted(body, order))
    except DofMapError:
        return
    assert proof.status == "grounded" or "6." in proof.hidden.remark


def test_a_long_bar_to_the_ground_beside_short_ones_is_sound() -> None:
    xyz = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5], [0.1, 0.5, 0.8], [1.6, 0.3, 0.2]]
    body = frame("part", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (3, 7), (4, 7)])
    assert prove_row_order(without(body, body.dofs.node == 1)).status == "proven"
