"""Elements beside supports against the deck, also where no uniform strain leaves all supports at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import Proof
from tests.pipeline.bodies.decks import brick_cards
from tests.pipeline.bodies.test_body_proofs import opened, proof_of
from tests.solids import block

CELLS, SIDES = (6, 2, 2), [1.5, 0.5, 0.75]
ROOT, TIP = range(1, 10), range(55, 64)
BOTH = ["SPC1,1,123,1,THRU,9", "SPC1,1,123,55,THRU,63"]


def proof(folder: Path, held: Sequence[int], cards: Sequence[str], factors: dict[int, float]) -> Proof:
    """Proof of the stiffness of a block whose cells have other moduli than the deck says."""
    moduli = [factors.get(cell, 1.0) for cell in range(24)]
    body = replace(block("part", SIDES, CELLS, held=held, moduli=moduli), grounded=False)
    return proof_of(opened(folder, body, [*brick_cards(CELLS), *cards]), "stiffness")


def test_nodes_beside_two_clamped_faces_are_compared(tmp_path: Path) -> None:
    found = proof(tmp_path, [*ROOT, *TIP], BOTH, {})
    assert found.state == "proven" and "at 45 of 45 nodes" in found.remark


@pytest.mark.parametrize("cell", [0, 1, 2, 3, 20, 23])
@pytest.mark.parametrize("factor", [3.0, 0.9])
def test_one_element_beside_a_support_is_found(tmp_path: Path, cell: int, factor: float) -> None:
    """With 3 times the modulus in one of 24, a body held at both ends has frequencies some per cent off."""
    found = proof(tmp_path, [*ROOT, *TIP], BOTH, {cell: factor})
    assert found.state == "refuted" and "single nodes" in found.remark


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_planes_of_symmetry_and_a_clamped_face(tmp_path: Path, factor: float) -> None:
    """Nodes in a plane of symmetry keep two of three rows."""
    body = block("part", SIDES, CELLS, moduli=[factor, *[1.0] * 23])
    x = np.repeat(body.nodes.xyz, 3, axis=0) if body.nodes is not None else np.zeros((0, 3))
    gone = (
        (x[:, 0] == SIDES[0])
        | ((x[:, 1] == 0) & (body.dofs.component == 2))
        | (x[:, 2] == 0) & (body.dofs.component == 3)
    )
    kept = np.flatnonzero(~gone)
    K, M = (sp.csc_array(A[kept][:, kept]) for A in (body.K, body.M))
    body = replace(body, K=K, M=M, dofs=body.dofs[kept], interfaces={}, grounded=False)
    whole = block("part", SIDES, CELLS)
    held = whole.dofs[np.flatnonzero(gone)]
    spc = [f"SPC1,1,{c},{n}" for n, c in zip(held.node, held.component, strict=True)]
    found = proof_of(opened(tmp_path, body, [*brick_cards(CELLS), *spc]), "stiffness")
    assert found.state == ("refuted" if factor > 1 else "proven")


def test_a_curved_support_is_left_out(tmp_path: Path) -> None:
    """Around a corner, no linear motion vanishes: the nodes beside it stay unknown, and the proof says how many."""
    held = [n for n in range(1, 64) if n <= 9 or n % 9 in (1, 2, 3)]
    cards = [f"SPC1,1,123,{n}" for n in held]
    found = proof(tmp_path, held, cards, {})
    assert found.state == "proven" and found.only == "some nodes"
