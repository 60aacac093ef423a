"""Stiffness of plates and bars at their nodes against the deck."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import FEModel, cross_matrix
from tests.frames import BAR, beam_matrices
from tests.pipeline.evidence.test_nodal_plates import BY_NODE, KINDS, Mesh, body, cards, plane
from tests.pipeline.evidence.test_nodal_stiffness import stiffness


def stiffened_edge(made: Mesh, kind: str, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> FEModel:
    """A plate with bars on the edge y = 0, beside their nodes by an offset."""
    free, arm = body(made, kind), np.eye(12)
    for end in (0, 6):
        arm[end : end + 3, end + 3 : end + 6] = -cross_matrix(np.array(offset))
    K = free.K.tolil()
    for a, b in pairwise(edge_of(made)):
        k, _ = beam_matrices(made.xyz[a - 1] + offset, made.xyz[b - 1] + offset, BAR)
        dofs = np.r_[6 * (a - 1) : 6 * a, 6 * (b - 1) : 6 * b]
        K[np.ix_(dofs, dofs)] += arm.T @ k @ arm
    return replace(free, K=sp.csc_array(K))


def edge_of(made: Mesh) -> list[int]:
    return [int(k) + 1 for k in np.flatnonzero(made.xyz[:, 1] == 0)]


def edge_cards(made: Mesh, offset: Sequence[float] = ()) -> list[str]:
    deck = cards(made)
    for number, (a, b) in enumerate(pairwise(edge_of(made))):
        deck.append(f"CBAR,{900 + number},9,{a},{b},0.,1.,0.")
        deck += [",,," + ",".join(str(v) for v in [*offset, *offset])] if offset else []
    deck.append(f"PBAR,9,9,{BAR.A:.6E},{BAR.Iz:.6E},{BAR.Iy:.6E},{BAR.J:.6E}")
    return [*deck, f"MAT1,9,{BAR.E:.6E},{BAR.G:.6E},,{BAR.rho}"]


@pytest.mark.parametrize("kind", KINDS)
def test_bars_beside_plates(tmp_path: Path, kind: str) -> None:
    """Bending of the bars in the plane of the plates is not compared."""
    made = plane()
    proof, failed = stiffness(tmp_path, stiffened_edge(made, kind), edge_cards(made))
    assert proof.state == "proven" and not [check for check in failed if "stiffness" in check.name]
    assert f"at {len(made.xyz)} of" in proof.remark and proof.label == "stiffness (stretch alone)"


@pytest.mark.parametrize("kind", KINDS)
def test_side_of_bars_beside_plates(tmp_path: Path, kind: str) -> None:
    """Bars on the other side of the plates have the same bending and stretch; both are coupled by the other sign."""
    made, offset = plane(), [0.0, 0.0, 0.03]
    for name, side, state in (("same", 0.03, "proven"), ("other", -0.03, "refuted")):
        folder = tmp_path / name
        folder.mkdir()
        stiff = stiffened_edge(made, kind, [0.0, 0.0, side])
        proof, failed = stiffness(folder, stiff, edge_cards(made, offset))
        assert proof.state == state, proof
        wrong = [check.name for check in failed if "stiffness" in check.name]
        assert wrong == ([BY_NODE] if state == "refuted" else [])
