"""Order of the generalised coordinates of a superelement: its mass couples them with the nodes of the interface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.model import DofTable, FEModel, Proof
from cmsreduce.pipeline.bodies import read_flexible
from tests.frames import frame
from tests.pipeline.bodies.decks import write_deck_body

WHOLE = frame(
    "part", [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5]], [(1, 2), (2, 3), (3, 4), (4, 5)]
)
MODES = 4


def superelement() -> FEModel:
    """Craig-Bampton matrices of the frame with its first and last node."""
    K, M = WHOLE.K.toarray(), WHOLE.M.toarray()
    held = np.isin(WHOLE.dofs.node, (1, 5))
    inside = np.ix_(~held, ~held)
    _, modes = la.eigh(K[inside], M[inside], subset_by_index=[0, MODES - 1])
    T = np.zeros((WHOLE.n, 12 + MODES))
    T[held, :12] = np.eye(12)
    T[~held, :12] = -np.linalg.solve(K[inside], K[np.ix_(~held, held)])
    T[~held, 12:] = modes
    table = DofTable(
        np.r_[WHOLE.dofs.node[held], 101 + np.arange(MODES)], np.r_[WHOLE.dofs.component[held], [0] * MODES]
    )
    return FEModel("part", sp.csc_array(T.T @ K @ T), sp.csc_array(T.T @ M @ T), table, WHOLE.nodes)


def mass_proof(folder: Path, body: FEModel) -> Proof:
    path = write_deck_body(folder, body, [f"SPOINT,101,THRU,{100 + MODES}"])
    path.write_text(path.read_text().replace(f"part.{100 + MODES},", "part.5,"))
    pipeline = load_pipeline(path)
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    return next(proof for proof in found.proofs if proof.what == "mass")


def test_the_order_of_the_modes_is_not_called_proven(tmp_path: Path) -> None:
    proof = mass_proof(tmp_path, superelement())
    assert proof.state == "unproven"
    assert f"nothing shows the order of the {MODES} generalised coordinates" in proof.remark


def without_mass_at_nodes(masses: list[float]) -> FEModel:
    """The modes with other masses, none of them coupled with the nodes; their stiffness is coupled by rounding."""
    body, scale = superelement(), np.sqrt(np.r_[np.ones(12), masses])
    K, M = (A.toarray() * np.outer(scale, scale) for A in (body.K, body.M))
    M[12:, :12] = M[:12, 12:] = 0
    return FEModel("part", sp.csc_array(K), sp.csc_array(M), body.dofs, body.nodes)


def test_modes_without_mass_at_nodes_have_no_order_if_their_masses_are_equal(tmp_path: Path) -> None:
    """An exchange of two of them in the mass changes no entry."""
    assert "generalised" not in mass_proof(tmp_path, without_mass_at_nodes([1.0] * MODES)).remark


def test_the_order_of_modes_without_mass_at_nodes_is_not_called_proven_if_their_masses_differ(tmp_path: Path) -> None:
    """The frequencies show no order: those of exchanged masses are as good."""
    proof = mass_proof(tmp_path, without_mass_at_nodes([1.0, 2.0, 0.5, 3.0]))
    assert proof.state == "unproven"
    assert f"nothing shows the order of the {MODES} generalised coordinates" in proof.remark
