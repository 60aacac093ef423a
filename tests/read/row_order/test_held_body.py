"""`grounded: true` and `rows: trusted`: what is proven of a body that the ground holds, and what is not."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read import prove_row_order
from tests.frames import frame
from tests.solids import block, face

CELLS = (8, 2, 2)


def exchanged(body: FEModel, a: int, b: int) -> FEModel:
    order = np.arange(body.n)
    order[body.dofs.node == a], order[body.dofs.node == b] = (
        np.flatnonzero(body.dofs.node == b),
        np.flatnonzero(body.dofs.node == a),
    )
    return replace(body, K=body.K[order][:, order], M=body.M[order][:, order])


def held() -> FEModel:
    """Block whose first face has no rows, though the geometry does not say that it is held."""
    return block("held", [4, 1, 1], CELLS, held=face(CELLS, 0))


@pytest.mark.parametrize(("cells", "edge"), [((8, 2, 2), False), ((8, 2, 2), True), ((5, 4, 4), True)])
@pytest.mark.parametrize("far", [False, True])
def test_an_exchange_near_supports_is_refused(cells: tuple[int, int, int], edge: bool, far: bool) -> None:
    """Nodes around it are as near to a support as to nodes that they couple, as those of sound wedges beside one."""
    index = 1 + np.arange(np.prod(np.array(cells) + 1)).reshape(np.array(cells) + 1)
    fixed = (index[:, 0, 0] if edge else index[0]).ravel()
    body = block("held", [1.6, 0.7, 0.5], cells, held=fixed)
    body = replace(body, constrained=DofTable(np.repeat(fixed, 3), np.tile([1, 2, 3], fixed.size)), grounded=False)
    assert prove_row_order(body).status == "proven"
    near = index[1:, 1:, 1:] if edge else index[1:3]
    for a, b in zip(near.ravel()[:-1:3], near.ravel()[1:][::-3] if far else near.ravel()[1::3], strict=False):
        if a != b:
            with pytest.raises(DofMapError, match="not proven"):
                prove_row_order(exchanged(body, int(a), int(b)))


@pytest.mark.parametrize("grounded", [False, True])
def test_a_layer_held_from_below_has_no_other_order(grounded: bool) -> None:
    """All nodes are beside supports; no motion leaves these at rest, which no order of the rows explains."""
    fixed = (1 + np.arange(88).reshape(11, 4, 2))[:, :, 0].ravel()
    body = block("held", [1.6, 0.7, 0.5], (10, 3, 1), held=fixed)
    supports = DofTable(np.repeat(fixed, 3), np.tile([1, 2, 3], fixed.size))
    assert prove_row_order(replace(body, constrained=supports, grounded=grounded)).status == "grounded"


def sprung() -> FEModel:
    """Block on springs to ground at the corners of its first face."""
    body = block("sprung", [4, 1, 1], CELLS)
    rows = np.concatenate([body.dofs.rows(node, [1, 2, 3]) for node in (1, 3, 7, 9)])
    k = np.zeros(body.n)
    k[rows] = 1e9
    return replace(body, K=sp.csc_array(body.K + sp.diags_array(k)), grounded=True)


@pytest.mark.parametrize("body", [held(), sprung()], ids=["clamped", "on springs"])
def test_nodes_away_from_the_ground_are_proven(body: FEModel) -> None:
    proof = prove_row_order(body)
    assert proof.status == "proven" and "the ground holds the body" in proof.remark
    assert ("next to the ground" in proof.remark) == (body.name == "held")


@pytest.mark.parametrize("body", [held(), sprung()], ids=["clamped", "on springs"])
@pytest.mark.parametrize(("a", "b"), [(40, 70), (41, 50), (33, 34)])
def test_exchanged_nodes_of_a_held_body_are_refused(body: FEModel, a: int, b: int) -> None:
    with pytest.raises(DofMapError, match="resist rotation and no translation, which no support does"):
        prove_row_order(exchanged(body, a, b))


def test_a_held_body_with_rows_by_component_is_refused() -> None:
    body = sprung()
    order = np.lexsort((body.dofs.node, body.dofs.component))
    wrong = replace(body, K=body.K[order][:, order], M=body.M[order][:, order])
    with pytest.raises(DofMapError, match="sorted by component"):
        prove_row_order(wrong)


def test_a_floating_body_is_not_grounded() -> None:
    floating = block("free", [4, 1, 1], CELLS)
    with pytest.raises(DofMapError, match="`grounded: true` says that the ground holds the body, but"):
        prove_row_order(replace(floating, grounded=True))


def test_a_spring_between_rotations_and_the_ground_is_a_support() -> None:
    xyz = [[0.0, 0, 0], [1, 0, 0], [2, 0.3, 0], [3, 0, 0.2], [4, 0, 0]]
    body = frame("mast", xyz, [(1, 2), (2, 3), (3, 4), (4, 5)])
    k = np.zeros(body.n)
    k[body.dofs.rows(1, [1, 2, 3, 4, 5, 6])] = 1e5
    proof = prove_row_order(replace(body, K=sp.csc_array(body.K + sp.diags_array(k)), grounded=True))
    assert proof.status == "proven" and "5 of 5 nodes" in proof.remark


def test_a_body_mostly_next_to_the_ground_is_unproven_by_name() -> None:
    proof = prove_row_order(block("stub", [1, 1, 1], (1, 1, 1), held=[1, 2, 3, 4]))
    assert proof.status == "grounded" and "4 of 4 nodes are next to the ground" in proof.remark


@pytest.mark.parametrize("body", [held(), sprung()], ids=["clamped", "on springs"])
@pytest.mark.parametrize(("digits", "words"), [(4, "4 digits"), (None, "multiples of 1e+06")])
def test_rounding_of_a_held_body_is_named(body: FEModel, digits: int | None, words: str) -> None:
    lower = sp.csc_array(sp.tril(body.K))
    lower.data = np.array([float(f"{v:.{digits - 1}e}") if digits else round(v / 1e6) * 1e6 for v in lower.data])
    coarse = replace(body, K=sp.csc_array(lower + sp.tril(lower, -1).T))
    proof = prove_row_order(coarse)
    assert proof.status == "grounded"
    assert f"rounded to {words}, which explains the forces against rigid motion at " in proof.remark
    assert "Write the matrix with all digits" in proof.remark
    if digits:
        assert prove_row_order(exchanged(coarse, 40, 70)).status == "grounded"
    else:
        with pytest.raises(DofMapError, match="resist rotation and no translation"):
            prove_row_order(exchanged(coarse, 40, 70))


def test_trust_replaces_the_proof_and_says_what_is_wrong() -> None:
    body = exchanged(block("free", [4, 1, 1], CELLS), 40, 70)
    with pytest.raises(DofMapError):
        prove_row_order(body)
    proof = prove_row_order(replace(body, rows_trusted=True))
    assert proof.status == "trusted" and "nodes resist" in proof.remark
    # A body that can be proven is proven, trusted or not.
    assert prove_row_order(replace(block("free", [4, 1, 1], CELLS), rows_trusted=True)).status == "proven"
    plain = FEModel("s", sp.csc_array(np.eye(2)), sp.csc_array(np.eye(2)), DofTable([1, 2], [0, 0]), rows_trusted=True)
    assert prove_row_order(plain).status == "trusted"


def test_motions_out_of_its_plane_prove_nothing_of_a_plane_body() -> None:
    """A plane truss that the deck holds: motions across its plane move no row of it, in whatever order."""
    xyz = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1.2, 1.1, 0], [2, 0.3, 0]]
    bars = [(1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (2, 5), (4, 5)]
    body = plane_truss(xyz, bars, held=[(1, 1), (1, 2), (3, 1)])
    proof = prove_row_order(body)
    assert (proof.status, proof.motions) == ("proven", 0)
    with pytest.raises(DofMapError):
        prove_row_order(exchanged(body, 4, 5))
    free = plane_truss(xyz, bars, held=[(1, 1)])
    assert (prove_row_order(free).status, prove_row_order(free).motions) == ("proven", 2)


def plane_truss(xyz: list[list[float]], bars: list[tuple[int, int]], held: list[tuple[int, int]]) -> FEModel:
    """Bars of one stiffness, with rows x and y."""
    at, n = np.array(xyz), 2 * len(xyz)
    K = np.zeros((n, n))
    for i, j in bars:
        arm = (at[j - 1] - at[i - 1])[:2]
        rows = [2 * i - 2, 2 * i - 1, 2 * j - 2, 2 * j - 1]
        stretch = np.concatenate([-arm, arm]) / np.linalg.norm(arm)
        K[np.ix_(rows, rows)] += 1e6 * np.outer(stretch, stretch) / np.linalg.norm(arm)
    dofs = DofTable(np.repeat(np.arange(1, len(xyz) + 1), 2), np.tile([1, 2], len(xyz)))
    gone = np.concatenate([dofs.rows(*one) for one in held])
    kept = np.setdiff1d(np.arange(n), gone)
    K = K[np.ix_(kept, kept)]
    nodes = Nodes.in_basic(np.arange(1, len(xyz) + 1), at)
    M = sp.eye_array(kept.size, format="csc")
    return FEModel("truss", sp.csc_array(K), M, dofs[kept], nodes, constrained=dofs[gone])


def held_in_a_plane(
    *,
    stated: bool,
    above: float | None = None,
    rows: Sequence[int] = (1, 2, 6),
    turn: Sequence[int] = (0, 1, 2),
    level: bool = False,
    ground: bool = True,
) -> FEModel:
    """Bars in space whose nodes move in x and y and turn about z alone, on springs to the ground at two nodes."""
    at = [[0, 0, 0], [0, 1, 0.3], [0, 2, 0.5], [1, 2, 0.9], [2, 2, 0.2], [2, 1, -0.4], [2, 0, 0.1], [1, 1, 1.0]]
    at += [[1, 3, 2.0]] if above is None else [[1 + above, 2, 2.0]]
    xyz = (np.array(at) * [1, 1, not level])[:, turn]
    body = frame("flat", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 7), (4, 8), (8, 2), (4, 9)])
    kept = np.flatnonzero(np.isin(body.dofs.component, rows))
    k = np.where(np.isin(body.dofs.node, [1, 7]), 1e5, 0.0)
    K = sp.csc_array(body.K + ground * sp.diags_array(k))[kept][:, kept]
    rest = body.dofs[np.setdiff1d(np.arange(body.n), kept)] if stated else None
    return replace(body, K=K, M=body.M[kept][:, kept], dofs=body.dofs[kept], constrained=rest, grounded=ground)


@pytest.mark.parametrize("stated", [False, True])
def test_a_body_that_supports_hold_in_a_plane_is_proven_there(stated: bool) -> None:
    """Motions out of the plane cost force: it was refused as shuffled or by component, or left without a proof."""
    body = held_in_a_plane(stated=stated)
    proof = prove_row_order(body)
    assert (proof.status, proof.motions) == (
        "proven",
        0,
    ) and "9 of 9 nodes resist rigid motion in a plane" in proof.remark
    for a, b in ((3, 5), (2, 8), (4, 9)):
        wrong = exchanged(body, a, b)
        if stated:
            assert prove_row_order(wrong).status == "grounded"
        else:
            with pytest.raises(DofMapError, match="resist rotation and no translation"):
                prove_row_order(wrong)


@pytest.mark.parametrize("level", [False, True])
@pytest.mark.parametrize("turn", [(0, 1, 2), (2, 0, 1)])
def test_rows_that_no_motion_in_the_plane_moves_are_not_proven(level: bool, turn: Sequence[int]) -> None:
    """Rotations out of the plane cost no force in any order there: exchanged ones were called proven."""
    along = sorted(turn.index(axis) + 1 for axis in (0, 1))
    body = held_in_a_plane(stated=False, rows=[*along, 4, 5, 6], turn=turn, level=level)
    first, second = along[0] + 3, along[1] + 3
    swapped = np.where(body.dofs.component == first, second, body.dofs.component)
    swapped[body.dofs.component == second] = first
    one = body.dofs.node.copy()
    one[body.dofs.rows(4, [first])], one[body.dofs.rows(9, [first])] = 9, 4
    for dofs in (body.dofs, DofTable(body.dofs.node, swapped), DofTable(one, body.dofs.component)):
        proof = prove_row_order(replace(body, dofs=dofs))
        assert proof.status == "grounded"
        assert re.search(r"only some rigid motions were tried.*leave 1[68] rows \(1\.[456], 1", proof.remark)


@pytest.mark.parametrize("above", [0.0, 4.999e-7, 2e-6])
@pytest.mark.parametrize("stated", [False, True])
def test_nodes_above_one_another_are_not_told_apart_in_a_plane(stated: bool, above: float) -> None:
    body = held_in_a_plane(stated=stated, above=above)
    assert prove_row_order(body).status == "grounded"
    with contextlib.suppress(DofMapError):
        assert prove_row_order(exchanged(body, 4, 9)).status == "grounded"


@pytest.mark.parametrize("rows", [(1,), (1, 4, 5, 6), (1, 2, 6), (1, 2, 4, 5, 6)])
def test_supports_leave_too_few_motions_to_prove_all_rows(rows: Sequence[int]) -> None:
    """The deck holds the other rows of every node, and nothing else: nodes in any order were called proven."""
    body = held_in_a_plane(stated=True, above=0.0, rows=rows, ground=False)
    for one in (body, exchanged(body, 4, 9)):
        proof = prove_row_order(one)
        assert proof.status == "grounded"
        assert "only some rigid motions were tried" in proof.remark or "next to the ground" in proof.remark
    assert prove_row_order(held_in_a_plane(stated=True, ground=False)).motions == 3


@pytest.mark.parametrize("off", [0.0, 3e-9])
def test_nodes_at_one_place_leave_the_proof_by_few_motions(off: float) -> None:
    """Bars that meet at two nodes in one place, as at a joint: no rigid motion tells these apart, few or all."""
    at = [[0.0, 0, 0], [1, 0, 0.2], [1.3, 1, 0], [0, 1, 1], [1.3 + off, 1, 0], [2, 1.5, 0.5], [2, 0.3, 0.8]]
    body = frame("joint", at, [(1, 2), (2, 3), (1, 4), (3, 4), (2, 4), (5, 6), (6, 7), (5, 7)])
    gone = body.dofs.rows(1, [1])
    kept = np.setdiff1d(np.arange(body.n), gone)
    K, M = (A[kept][:, kept] for A in (body.K, body.M))
    proof = prove_row_order(replace(body, K=K, M=M, dofs=body.dofs[kept], constrained=body.dofs[gone]))
    assert (proof.status, proof.motions) == ("proven", 5)


def test_nodes_without_rows_leave_supports_across_a_plane_to_be_stated() -> None:
    """They look condensed, and condensed dofs move with a rigid motion."""
    body = held_in_a_plane(stated=False)
    kept = ~np.isin(body.dofs.node, [1, 7])
    rows = replace(body, K=body.K[kept][:, kept], M=body.M[kept][:, kept], dofs=body.dofs[kept])
    with pytest.raises(DofMapError, match=r"no node has a row across one plane.*345 in the field PS of GRID"):
        prove_row_order(rows)
