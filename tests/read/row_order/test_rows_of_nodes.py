"""Rows that move alike under rigid motion, exchanged in both matrices: K R = 0 holds in either order."""

from __future__ import annotations

import contextlib
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, Finding, Nodes
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.bodies.stiffness_proof import _rows
from cmsreduce.pipeline.evidence import NodesAgainstDeck
from cmsreduce.pipeline.store import Silent
from cmsreduce.read import prove_row_order
from cmsreduce.read.row_order.rows_of_nodes import prove_rows_of_nodes
from tests.frames import frame, line
from tests.hard.corruptions.study import Study
from tests.plates import isotropic_laminate, plate_body
from tests.solids import block


def crossed(seed: int, count: int = 30) -> FEModel:
    """Frame of bars between near nodes at places without order."""
    xyz = np.random.default_rng(seed).random((count, 3))
    near = np.argsort(np.linalg.norm(xyz[:, None] - xyz, axis=2), axis=1)[:, 1:4]
    return frame("f", xyz, sorted({(min(i, j) + 1, max(i, j) + 1) for i in range(count) for j in near[i]}))


def tower() -> FEModel:
    """Bars along x, y and z: each component couples few others."""
    xyz = np.array([(i, j, k) for k in range(4) for j in range(2) for i in range(2)], dtype=float)
    apart = abs(xyz[:, None] - xyz).sum(axis=2)
    return frame("t", xyz, [(i + 1, j + 1) for i in range(16) for j in range(i + 1, 16) if apart[i, j] == 1])


def bent() -> FEModel:
    """Straight parts along x, y and z: the last bar shares a rotation with the one before."""
    places = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (2, 1, 0), (2, 2, 0), (2, 2, 1)], dtype=float)
    return frame("b", places, [(i, i + 1) for i in range(1, 6)])


def plate(count: int = 6, across: int = 5) -> FEModel:
    xyz = [(i / count, j / across, 0.0) for i in range(count + 1) for j in range(across + 1)]
    row = across + 1
    cells = [[k + 1, k + 1 + row, k + 2 + row, k + 2] for i in range(count) for k in range(row * i, row * i + across)]
    return plate_body("p", xyz, cells, lambda _: isotropic_laminate(70e9, 0.3, 2e-3))


def star(count: int = 4) -> FEModel:
    """Bars from one node to others, all along one line."""
    return frame("s", [(i, 0, 0) for i in range(count + 1)], [(1, i + 2) for i in range(count)])


def solid() -> FEModel:
    return block("s", (1.0, 0.8, 0.7), (5, 4, 3))


def held() -> FEModel:
    xyz = np.array([(i, 0.1 * i * i, 0.0) for i in range(20)], dtype=float)
    return frame("h", xyz, [(i, i + 1) for i in range(1, 20)], held=(1,))


def permuted(body: FEModel, order: np.ndarray) -> FEModel:
    K, M = (sp.csc_array(A[order][:, order]) for A in (body.K, body.M))
    return replace(body, K=K, M=M)


def exchanged(body: FEModel, *pairs: tuple[str, str]) -> FEModel:
    """Body with rows in each other's place, by their labels."""
    order, labels = np.arange(body.n), list(body.dofs.labels)
    for one, other in pairs:
        i, j = labels.index(one), labels.index(other)
        order[[i, j]] = order[[j, i]]
    return permuted(body, order)


SOUND = [crossed(9), tower(), bent(), plate(), solid(), held(), line("l", (0, 0, 0), (1, 0, 0), 10)]


@pytest.mark.parametrize("body", SOUND, ids=["crossed", "tower", "bent", "plate", "solid", "held", "line"])
def test_sound_bodies_are_proven_whole(body: FEModel) -> None:
    proof = prove_row_order(body)
    assert (proof.status, proof.hidden.only) == ("proven", "")


@pytest.mark.parametrize(
    ("body", "one", "other"),
    [
        *((crossed(0), f"3.{turn}", f"9.{turn}") for turn in (4, 5, 6)),
        (tower(), "2.5", "10.5"),
        (plate(), "8.4", "29.4"),
        (plate(), "9.6", "10.6"),
        (solid(), "24.1", "64.1"),
        (held(), "9.6", "15.6"),
        (line("l", (0, 0, 0), (1, 0, 0), 10), "3.5", "4.5"),
    ],
)
def test_two_exchanged_rows_are_named(body: FEModel, one: str, other: str) -> None:
    with pytest.raises(DofMapError) as caught:
        prove_row_order(exchanged(body, (one, other)))
    assert f"the row labelled {one} is that of {other}; the row labelled {other} is that of {one}" in str(caught.value)


@pytest.mark.parametrize("turns", [[5], [4, 5, 6]])
@pytest.mark.parametrize("seed", range(4))
def test_rotations_in_the_order_of_other_nodes_are_refused(seed: int, turns: Sequence[int]) -> None:
    body, order = crossed(seed), np.arange(180)
    shuffled = np.random.default_rng(seed).permutation(30)
    for turn in turns:
        order[turn - 1 :: 6] = order[turn - 1 :: 6][shuffled]
    with pytest.raises(DofMapError, match=r"rows couple other nodes than the other rows of their node"):
        prove_row_order(permuted(body, order))


def condensed() -> FEModel:
    """Every dof couples every other one."""
    whole = crossed(2)
    kept, gone = np.flatnonzero(whole.dofs.node <= 6), np.flatnonzero(whole.dofs.node > 6)
    K = whole.K.toarray()
    T = np.linalg.solve(K[np.ix_(gone, gone)], K[np.ix_(gone, kept)])
    small = K[np.ix_(kept, kept)] - K[np.ix_(kept, gone)] @ T
    return FEModel("c", sp.csc_array(small), sp.csc_array(np.eye(36)), whole.dofs[kept], nodes=whole.nodes)


@pytest.mark.parametrize(
    ("body", "component"),
    [
        (line("l", (0, 0, 0), (1, 0, 0), 10), 1),
        *((condensed(), turn) for turn in (4, 5, 6)),
        *((tower(), component) for component in range(1, 7)),
        *((bent(), component) for component in range(1, 7)),
        (block("s", (1.0, 0.8, 0.7), (2, 2, 3)), 3),
        *((star(), component) for component in range(1, 7)),
    ],
)
def test_no_exchange_is_called_proven(body: FEModel, component: int) -> None:
    # Along a straight bar the rows of x share no dof with others.
    for a in body.dofs.node_ids:
        for b in range(1, a):
            wrong = exchanged(body, (f"{a}.{component}", f"{b}.{component}"))
            with contextlib.suppress(DofMapError):
                assert prove_row_order(wrong).hidden.only


@pytest.mark.parametrize(("first", "last"), [(3, 6), (2, 6), (4, 8), (1, 7), (5, 11)])
@pytest.mark.parametrize("component", [1, 4])
def test_a_part_of_a_chain_from_end_to_end_is_not_proven(component: int, first: int, last: int) -> None:
    turned = [(f"{a}.{component}", f"{first + last - a}.{component}") for a in range(first, (first + last + 1) // 2)]
    wrong = exchanged(line("l", (0, 0, 0), (1, 0, 0), 10), *turned)
    with contextlib.suppress(DofMapError):
        proof = prove_row_order(wrong).hidden
        assert proof.only == "55 of 66 rows" and f"1.{component}" in proof.remark


@pytest.mark.parametrize("large", [partial(plate, 40, 40), partial(star, 3000)], ids=["plate", "star"])
def test_memory_grows_with_the_entries_alone(large: Callable[[], FEModel]) -> None:
    body = large()
    assert body.nodes is not None
    tracemalloc.start()
    prove_rows_of_nodes(body, body.nodes)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # A row for each dof and a column for each node: 15 MB and 54 MB in bytes.
    assert peak < 5e6 + 4 * (body.K.data.nbytes + body.K.indices.nbytes)


def test_the_verdict_counts_the_rows_that_are_proven(tmp_path: Path) -> None:
    body = exchanged(line("arm", (0, 0, 0), (0.8, 0, 0), 4), ("2.4", "4.4"))
    study = Study(deck=False)
    study.K["arm"], study.M["arm"] = body.K.toarray(), body.M.toarray()
    assert body.nodes is not None
    study.xyz["arm"] = body.nodes.xyz
    path = study.write(tmp_path)
    result = execute(Run(load_pipeline(path, []), tmp_path / "out", Silent()), path, report=False)
    assert result is not None
    rows = next(each for each in result.verdict.proofs if (each.subject, each.what) == ("arm", "row order"))
    assert rows.only.endswith("of 30 rows") and "2.4" in rows.remark


def test_rotations_stay_left_out_beside_a_deck_and_no_shown_row_is_no_proof() -> None:
    body = exchanged(line("arm", (0, 0, 0), (0.8, 0, 0), 2), ("1.4", "3.4"))
    rows, none = prove_row_order(body), np.zeros(0, dtype=bool)
    assert rows.hidden.turning and not rows.hidden.every
    agrees = NodesAgainstDeck(Finding("stiffness of each node against the deck", 0.0, 1e-6), 3, 3, none)
    solids = replace(rows, hidden=rows.hidden._replace(turning=False))
    proofs = [_rows(found, agrees)[1] for found in (rows, solids)]
    assert [(each.state, each.only) for each in proofs] == [("proven", rows.hidden.only), ("proven", "")]
    assert rows.hidden.only == "14 of 18 rows"


def test_a_body_of_which_no_row_is_shown_is_unproven_and_can_be_trusted() -> None:
    """Corners of a block, each of which couples all others: any order along an edge."""
    whole = block("s", (1.0, 0.8, 0.7), (2, 2, 2))
    assert whole.nodes is not None
    xyz = whole.nodes.xyz - whole.nodes.xyz.mean(axis=0)
    corner = (abs(xyz) > 0.99 * abs(xyz).max(axis=0)).all(axis=1)
    kept = np.isin(whole.dofs.node, whole.nodes.id[corner])
    K = whole.K.toarray()
    small = K[np.ix_(kept, kept)] - K[np.ix_(kept, ~kept)] @ np.linalg.solve(K[np.ix_(~kept, ~kept)], K[~kept][:, kept])
    nodes = Nodes(whole.nodes.id[corner], whole.nodes.xyz[corner], whole.nodes.frame[corner])
    body = FEModel("c", sp.csc_array((small + small.T) / 2), sp.csc_array(np.eye(24)), whole.dofs[kept], nodes=nodes)
    found = _rows(prove_row_order(body), None)[1]
    assert found.state == "unproven" and found.remark.startswith("24 rows (")
    trusted = prove_row_order(replace(body, rows_trusted=True))
    assert trusted.status == "trusted" and trusted.remark == found.remark
