"""Orders from the other end in both matrices: K R = 0 holds in either, and other nodes are told apart by nothing."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read import prove_row_order
from cmsreduce.read.row_order.other_ends import prove_chains
from tests.frames import frame
from tests.read.row_order.test_unseen_rows import permuted, without
from tests.solids import block, face

CELLS = (5, 2, 2)
UNEVEN = [[x, 0.0, 0.0] for x in (0, 0.1, 0.25, 0.3, 0.5, 0.8)]
BARS = [(i, i + 1) for i in range(1, 6)]


def of_two_materials() -> FEModel:
    return block("part", [1.0, 0.4, 0.3], CELLS, moduli=[1 if k < 10 else 3 for k in range(20)])


def reversed_nodes(body: FEModel, component: int = 0) -> FEModel:
    order, ids = np.arange(body.n), body.dofs.node_ids
    for node, other in zip(ids, ids[::-1], strict=True):
        for row in np.flatnonzero((body.dofs.node == node) & (not component or body.dofs.component == component)):
            order[row] = body.dofs.rows(other, body.dofs.component[row : row + 1])[0]
    return permuted(body, order)


@pytest.mark.parametrize("held", [(), (0, 5)], ids=["free", "held at both ends"])
def test_a_block_of_two_materials_may_be_its_mirror_image(held: tuple[int, ...]) -> None:
    """Reversed nodes put the stiff half at the other end: it was proven, with all rows."""
    whole = of_two_materials()
    gone = np.isin(whole.dofs.node, [n for end in held for n in face(CELLS, end)])
    body = without(whole, gone) if held else whole
    for each in (body, reversed_nodes(body)):
        proof = prove_row_order(each)
        assert (proof.status, proof.hidden.only) == ("proven", "order or its mirror image")
        assert proof.hidden.remark.startswith("the nodes are their own mirror image") and not proof.hidden.turning


def test_supports_at_one_end_and_one_material_show_the_order() -> None:
    clamped = of_two_materials()
    clamped = without(clamped, np.isin(clamped.dofs.node, face(CELLS, 0)))
    uniform = block("part", [1.0, 0.4, 0.3], CELLS)
    for each in (clamped, uniform):
        proof = prove_row_order(each)
        assert (proof.status, proof.hidden.only) == ("proven", "")
    assert prove_row_order(reversed_nodes(clamped)).status == "grounded"


@pytest.mark.parametrize("component", [1, 4])
def test_a_chain_in_reverse_is_not_proven(component: int) -> None:
    """Stretch or twist of a straight line of bars of other lengths."""
    body = frame("part", UNEVEN, BARS)
    wrong = reversed_nodes(body, component)
    assert abs(wrong.K - body.K).max() > 0.1 * abs(body.K).max() * (1 if component == 1 else 1e-6)
    for each in (body, wrong):
        proof = prove_row_order(each)
        assert (proof.status, proof.hidden.only) == ("proven", "24 of 36 rows")
        assert "are chains that share no stiffness" in proof.hidden.remark


@pytest.mark.parametrize("component", [1, 4])
def test_a_support_shows_the_direction_of_a_chain(component: int) -> None:
    body = frame("part", UNEVEN, BARS)
    body = without(body, body.dofs.node == 1)
    assert prove_row_order(body).hidden.only == ""
    assert prove_row_order(reversed_nodes(body, component)).hidden.only == "25 of 30 rows"


def test_a_uniform_chain_with_one_heavy_end_is_not_proven() -> None:
    """The stiffness is the same in reverse, and the mass is not."""
    body = frame("part", [[0.1 * i, 0.0, 0.0] for i in range(6)], BARS)
    assert prove_row_order(body).hidden.only == ""
    more = np.where((body.dofs.node == 6) & (body.dofs.component <= 3), 2.0, 0.0)
    heavy = replace(body, M=sp.csc_array(body.M + sp.diags_array(more)))
    assert prove_row_order(heavy).hidden.only == "30 of 36 rows"


def rods(lines: int, count: int) -> FEModel:
    """Lines of rods along x side by side, whose nodes have rows along x alone; every second line is uniform."""
    stretch = np.zeros((lines, count))
    stretch[:, :-1] = np.where(np.arange(lines)[:, None] % 2, 1.0, 1.0 + np.arange(count - 1) / count)
    off = -stretch.ravel()[:-1]
    K = sp.diags_array([(stretch + np.roll(stretch, 1, axis=1)).ravel(), off, off], offsets=[0, 1, -1])
    ids, (line, along) = np.arange(1, lines * count + 1), np.divmod(np.arange(lines * count), count)
    xyz = np.stack([0.1 * along, line, line**2 / lines], axis=1)
    table = DofTable(ids, np.ones(ids.size, dtype=int))
    return FEModel("part", sp.csc_array(K), sp.eye_array(ids.size, format="csc"), table, Nodes.in_basic(ids, xyz))


def test_each_of_several_chains_is_judged_by_itself() -> None:
    body = rods(6, 5)
    found = prove_chains(body, body.nodes, np.zeros(body.n, dtype=np.int64)).rows
    assert found.tolist() == [row for row in range(30) if row // 5 % 2 == 0]


def test_many_chains_cost_no_more_than_few() -> None:
    """4000 of them took 3.7 s, and 40 with as many rows 0.04 s."""
    cost = []
    for lines in (40, 4000):
        body = rods(lines, 16000 // lines)
        kind = np.zeros(body.n, dtype=np.int64)
        start = time.process_time()
        prove_chains(body, body.nodes, kind)
        cost.append(time.process_time() - start)
    assert cost[1] < 5 * cost[0] + 0.1
