"""Bars and springs between nodes of solids and of rigid elements against the deck."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.model import DofTable, FEModel, Nodes, Proof, cross_matrix
from cmsreduce.pipeline.bodies import read_flexible
from tests.frames import rotation
from tests.pipeline.bodies.decks import brick_cards, write_deck_body
from tests.solids import block, face

CELLS, SIDES, GAP = (3, 2, 2), (0.6, 0.2, 0.2), 0.1
ONE, RATES = block("part", SIDES, CELLS), (3e6, 1e6, 2e6, 5e3, 4e3, 7e3)
COUNT = len(ONE.nodes.id)  # type: ignore[union-attr]
LONG = np.array([1.0, 0.0, 0.0])
XYZ = np.vstack([ONE.nodes.xyz, ONE.nodes.xyz + (SIDES[0] + GAP) * LONG])  # type: ignore[union-attr]
HUBS = np.array([[0.62, 0.1, 0.1], [0.69, 0.12, 0.1]])


def second_block(cards: list[str]) -> list[str]:
    """The bricks of a block and those of another, whose nodes follow."""
    found = list(cards)
    for k in range(0, len(cards) - 2, 2):
        first = cards[k].split(",")
        ids = [int(v) + COUNT for v in [*first[3:], *cards[k + 1].split(",")[1:]]]
        found += [f"CHEXA,{1000 + k},1," + ",".join(map(str, ids[:6])), f",{ids[6]},{ids[7]}"]
    return found


def bush(a: np.ndarray, b: np.ndarray, at: np.ndarray, axes: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """Stiffness (12, 12) of springs at a point between two nodes, from the motion of one side against the other."""
    moved = np.zeros((6, 12))
    for dof in range(12):
        u, turn = np.zeros((2, 3)), np.zeros((2, 3))
        (u, turn)[dof % 6 // 3][dof // 6, dof % 3] = 1.0
        sides = [u[k] + np.cross(turn[k], at - (a, b)[k]) for k in (0, 1)]
        moved[:, dof] = np.r_[axes @ (sides[1] - sides[0]), axes @ (turn[1] - turn[0])]
    return moved.T @ np.diag(rates) @ moved


def hub_body(k: np.ndarray) -> tuple[FEModel, list[str]]:
    """Two blocks whose facing sides two rigid elements hold, and a stiffness between the points of these; no dofs of
    the nodes that follow."""
    n = 3 * COUNT
    K, M = (la.block_diag(A.toarray(), A.toarray(), np.zeros((12, 12))) for A in (ONE.K, ONE.M))
    K[2 * n :, 2 * n :] += k
    faces = [np.array(face(CELLS, CELLS[0])), np.array(face(CELLS, 0)) + COUNT]
    led = np.concatenate([(3 * (ids - 1)[:, None] + np.arange(3)).ravel() for ids in faces])
    free = np.setdiff1d(np.arange(2 * n + 12), led)
    T = np.zeros((2 * n + 12, 2 * n + 12))
    T[free, free] = 1
    for k_, ids in enumerate(faces):
        for node in ids:
            rows, to = 3 * (node - 1) + np.arange(3), 2 * n + 6 * k_
            T[rows, to : to + 3] = np.eye(3)
            T[np.ix_(rows, np.arange(to + 3, to + 6))] = -cross_matrix(XYZ[node - 1] - HUBS[k_])
    node = np.r_[np.repeat(np.arange(1, 2 * COUNT + 1), 3), np.repeat([901, 902], 6)]
    component = np.r_[np.tile([1, 2, 3], 2 * COUNT), np.tile(np.arange(1, 7), 2)]
    nodes = Nodes.in_basic([*range(1, 2 * COUNT + 1), 901, 902], np.vstack([XYZ, HUBS]))
    K, M = T.T @ K @ T, T.T @ M @ T
    keep = np.ix_(free, free)
    body = FEModel("part", sp.csc_array(K[keep]), sp.csc_array(M[keep]), DofTable(node[free], component[free]), nodes)
    cards = second_block(brick_cards(CELLS))
    for hub, ids in zip((901, 902), faces, strict=True):
        cards += [f"RBE2,{hub},{hub},123," + ",".join(map(str, ids[:5])), "," + ",".join(map(str, ids[5:]))]
    return body, cards


def stiffness(folder: Path, body: FEModel, cards: list[str]) -> Proof:
    folder.mkdir(exist_ok=True)
    pipeline = load_pipeline(write_deck_body(folder, body, cards))
    return next(one for one in read_flexible(pipeline, "part", build_scene(pipeline)).proofs if one.what == "stiffness")


PBUSH = "PBUSH,7,K," + ",".join(f"{rate:.1E}" for rate in RATES)
ALONG = (HUBS[1] - HUBS[0]) / np.linalg.norm(HUBS[1] - HUBS[0])
ASIDE = np.cross(ALONG, [0.0, 0.0, 1.0])
ASIDE /= np.linalg.norm(ASIDE)
TURNED = rotation([1.0, 2.0, 0.5], 0.7)
SYSTEM = ["CORD2R,5,,0.,0.,0.," + ",".join(f"{v:.9f}" for v in TURNED[2])]
SYSTEM += ["," + ",".join(f"{v:.9f}" for v in TURNED[0])]


@pytest.mark.parametrize(
    ("cards", "share", "axes"),
    [
        (["CBUSH,7,7,901,902,,,,0"], 0.5, np.eye(3)),
        (["CBUSH,7,7,901,902,,,,0", ",.2"], 0.2, np.eye(3)),
        (
            ["CBUSH,7,7,901,902,,,,5", ",.9", *SYSTEM],
            0.9,
            TURNED,
        ),
        (
            ["CBUSH,7,7,901,902,0.,0.,1."],
            0.5,
            np.array([ALONG, np.cross(ASIDE, ALONG), ASIDE]),
        ),
    ],
    ids=["basic", "place", "system", "line"],
)
def test_a_bush_between_rigid_elements(tmp_path: Path, cards: list[str], share: float, axes: np.ndarray) -> None:
    """A soft bush holds two stiff blocks; no strain of the blocks shows it."""
    place = HUBS[0] + share * (HUBS[1] - HUBS[0])
    # A rate with its sensible changes: all a hundred times, one of six, axes of another.
    for name, rates, state in (
        ("sound", RATES, "proven"),
        ("stiff", 100 * np.array(RATES), "refuted"),
        ("one", (*RATES[:5], 1.1 * RATES[5]), "refuted"),
        ("order", (RATES[1], RATES[0], *RATES[2:]), "refuted"),
    ):
        body, made = hub_body(bush(*HUBS, place, axes, np.array(rates)))
        proof = stiffness(tmp_path / name, body, [*made, PBUSH, *cards])
        assert proof.state == state, (name, proof.remark)
        assert ("between nodes 901 and 902" in proof.remark) == (state == "refuted")
        assert proof.label == ("stiffness (some nodes alone)" if state == "proven" else "stiffness")


def test_bricks_beside_rigid_elements_are_compared(tmp_path: Path) -> None:
    """What is on nodes without rows leaves only a lower bound of the energy, which a stiffer body meets."""
    body, cards = hub_body(bush(*HUBS, HUBS.mean(axis=0), np.eye(3), np.array(RATES)))
    made = [*cards, PBUSH, "CBUSH,7,7,901,902,,,,0"]
    for factor in (1.01, 1000.0):
        wrong = replace(body, K=sp.csc_array(factor * body.K))
        proof = stiffness(tmp_path / str(factor), wrong, made)
        assert proof.state == "refuted" and f"{factor:g} times that of the deck" in proof.remark


@pytest.mark.parametrize("named", [True, False])
def test_springs_between_nodes_of_solids(tmp_path: Path, named: bool) -> None:
    """Two blocks that touch, held together by springs: the nodes of solids are compared by strains alone."""
    xyz = np.vstack([XYZ[:COUNT], XYZ[:COUNT] + SIDES[0] * LONG])
    pairs = list(zip(face(CELLS, CELLS[0]), (node + COUNT for node in face(CELLS, 0)), strict=True))
    table = DofTable(np.repeat(np.arange(1, 2 * COUNT + 1), 3), np.tile([1, 2, 3], 2 * COUNT))
    M = sp.block_diag([ONE.M, ONE.M], format="csc")

    def joined(rate: float) -> FEModel:
        K = la.block_diag(ONE.K.toarray(), ONE.K.toarray())
        for a, b in pairs:
            for c in range(3):
                rows = np.ix_([3 * a - 3 + c, 3 * b - 3 + c], [3 * a - 3 + c, 3 * b - 3 + c])
                K[rows] += rate * np.array([[1, -1], [-1, 1]])
        return FEModel("part", sp.csc_array(K), M, table, Nodes.in_basic(range(1, 2 * COUNT + 1), xyz))

    cards = second_block(brick_cards(CELLS))
    if named:
        cards += [f"CBUSH,{a},9,{a},{b},,,,0" for a, b in pairs] + ["PBUSH,9,K,1.+7,1.+7,1.+7"]
    else:
        cards += [f"CELAS2,{10 * a + c},1.+7,{a},{c},{b},{c}" for a, b in pairs for c in (1, 2, 3)]
    proof = stiffness(tmp_path / "sound", joined(1e7), cards)
    assert (proof.state, proof.label) == (
        "proven",
        "stiffness (uniform strain alone)",
    ) and "at 72 of 72 nodes" in proof.remark
    for rate, ratio in ((1e9, "100"), (1e5, "0.01"), (9.9e6, "0.99")):
        proof = stiffness(tmp_path / ratio, joined(rate), cards)
        assert proof.state == "refuted" and f"more pairs; at the first {ratio} times that of the deck" in proof.remark
