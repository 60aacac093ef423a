"""Modal integrals of superelements by MUG1 and the masses of the deck: of a body made here, and of one that NX made."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from pyyeti.nastran import op4

from cmsreduce.mechanics import Tie, modal_integrals, tie_nodes
from cmsreduce.model import FEModel, cross_matrix
from cmsreduce.read import (
    InterfaceSpec,
    MatrixSource,
    prove_row_order,
    read_body,
    superelement_matrices,
    with_inner_grids,
)

PYNASTRAN = os.environ.get("PYNASTRAN_CLONE", "")

# A beam of six grids on a curve; the axes of displacements of grid 4 are turned about z.
PLACES = np.array([[0, 0, 0], [1, 0.1, 0], [2, 0.4, 0.1], [3, 0.9, 0.3], [4, 1.6, 0.6], [5, 2.5, 1.0]])
DECK = "\n".join(
    [
        "BEGIN BULK",
        "CORD2R,9,,0.,0.,0.,0.,0.,1.",
        "+,0.,1.,0.",
        *(f"GRID,{k},,{x:.1f},{y:.1f},{z:.1f},{9 if k == 4 else 0}" for k, (x, y, z) in enumerate(PLACES, start=1)),
        *(f"CONM2,{100 + k},{k},,{2 + k}.,.1,-.2,.3,,+\n+,.8,.01,.9,.02,.03,1." for k in range(1, 7)),
        "SPOINT,91,THRU,93",
        "BSET1,123456,1,6",
        "QSET1,0,91,THRU,93",
        "ENDDATA",
    ]
)


def full_model() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stiffness, mass and rigid motions about the origin of the beam, without its frames being turned back."""
    K, M, R, turned = np.zeros((36, 36)), np.zeros((36, 36)), np.zeros((36, 6)), np.eye(36)
    for k, x in enumerate(PLACES):
        R[6 * k : 6 * k + 3] = np.hstack([np.eye(3), -cross_matrix(x)])
        R[6 * k + 3 : 6 * k + 6, 3:] = np.eye(3)
        m, s = 3.0 + k, cross_matrix(np.array([0.1, -0.2, 0.3]))
        J = np.array([[0.8, -0.01, -0.02], [-0.01, 0.9, -0.03], [-0.02, -0.03, 1.0]])
        M[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = np.block([[m * np.eye(3), -m * s], [m * s, J - m * s @ s]])
    for k in range(5):
        # Motion of a grid beside the rigid motion of the one before.
        two = slice(6 * k, 6 * k + 12)
        arm = np.block([[np.eye(3), -cross_matrix(PLACES[k + 1] - PLACES[k])], [np.zeros((3, 3)), np.eye(3)]])
        apart = np.hstack([-arm, np.eye(6)])
        K[two, two] += apart.T @ np.diag([9e4, 3e4, 4e4, 1e4, 2e4, 3e4]) @ apart
    # The x axis of frame 9 is the y axis of basic.
    axes = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    turned[18:24, 18:24] = np.kron(np.eye(2), axes)
    return turned @ K @ turned.T, turned @ M @ turned.T, turned @ R


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """OUTPUT4 file of a Craig-Bampton superelement of three modes with MUG1, and its deck."""
    K, M, _ = full_model()
    b = np.r_[0:6, 30:36]
    o = np.arange(6, 30)
    T = np.zeros((36, 15))
    T[b, np.arange(12)] = 1.0
    T[o, :12] = -la.solve(K[np.ix_(o, o)], K[np.ix_(o, b)])
    T[o, 12:] = la.eigh(K[np.ix_(o, o)], M[np.ix_(o, o)])[1][:, :3]
    path = tmp_path / "out.op4"
    op4.write(str(path), ["kxx", "mxx", "mug1"], [T.T @ K @ T, T.T @ M @ T, T])
    (tmp_path / "deck.bdf").write_text(DECK + "\n")
    return path, tmp_path / "deck.bdf"


def read(path: Path, deck: Path, **interfaces: InterfaceSpec) -> FEModel:
    stiffness, mass = (MatrixSource(path, name) for name in ("kxx", "mxx"))
    return read_body("x", stiffness=stiffness, mass=mass, geometry=deck, interfaces=interfaces)


def test_all_integrals_are_those_of_the_grids(files: tuple[Path, Path]) -> None:
    """int phi_i phi_j dm and int r_i phi_j dm are sums over the lumps of the deck, places and offsets included."""
    body = read(*files)
    assert prove_row_order(body).status == "proven"
    assert modal_integrals(body, np.eye(15)).second_order is None
    grown, reason = with_inner_grids(body, *files)
    assert reason == ""
    T, R = op4.read(str(files[0]))["mug1"], full_model()[2]
    assert grown.tied is not None
    np.testing.assert_allclose(grown.recovery.T.toarray()[15:], T[6:30], atol=1e-12)
    shapes = np.eye(15)[:, 9:]
    found = modal_integrals(grown, shapes)
    np.testing.assert_allclose(np.einsum("iiab->ab", found.phi_phi), body.M.toarray()[9:, 9:], atol=1e-9)
    # Rigid motions of the body have the integrals of its points: int x x dm, of lumps with their own inertia.
    rigid = np.linalg.lstsq(T, R, rcond=None)[0]
    of_rigid = modal_integrals(grown, rigid)
    moved = found.mass * np.einsum("ia,jb->ijab", np.eye(3), np.eye(3))
    np.testing.assert_allclose(of_rigid.phi_phi[:, :, :3, :3], moved, atol=1e-10)
    turn = np.stack([np.cross(np.eye(3)[k], np.eye(3)) for k in range(3)])
    second = np.einsum("kpi,lqj,pq->ijkl", turn, turn, found.second_moment)
    np.testing.assert_allclose(of_rigid.phi_phi[:, :, 3:, 3:], second, atol=1e-8)


def test_a_tie_and_units_keep_the_grids(files: tuple[Path, Path]) -> None:
    body, reason = with_inner_grids(read(*files, ends=InterfaceSpec((1, 6))), *files)
    assert reason == ""
    tied = tie_nodes(body, "ends", Tie("rigid"))
    found = modal_integrals(tied, np.eye(tied.n))
    np.testing.assert_allclose(np.einsum("iiab->ab", found.phi_phi), tied.M.toarray(), atol=1e-8)


def test_recovery_that_does_not_fit_is_not_used(files: tuple[Path, Path]) -> None:
    path, deck = files
    body = read(path, deck)
    for change, words in (
        (("CONM2,103,3,,5.", "CONM2,103,3,,5.1"), "differs from that of the superelement by 0.0"),
        (("CONM2,103,3,,5.", "CONM2,103,3,9,5."), "differs from that of the superelement by 0.1"),
        (("CONM2,103,3,,5.", "CONM2,103,3,8,5."), "states no masses"),
        (("SPOINT,91", "GRID,7\nSPOINT,91"), "36 rows are not six for each grid"),
    ):
        assert change[0] in DECK
        deck.write_text(DECK.replace(*change) + "\n")
        same, reason = with_inner_grids(replace(body, nodes=read(path, deck).nodes), path, deck)
        assert same.tied is None
        assert words in reason


@pytest.mark.skipif(not PYNASTRAN, reason="PYNASTRAN_CLONE names no clone of SteveDoyle2/pyNastran")
def test_a_superelement_of_nx_has_all_its_integrals() -> None:
    """EXTSEOUT(DMIGOP2) of NX: a plate of 144 CQUAD4 on four corners; a table of the file names its matrices."""
    models = Path(PYNASTRAN) / "models"
    path, deck = models / "other" / "extse04c_cnv2_0.op2", models / "superelements" / "extse04c.bdf"
    found = superelement_matrices(path)
    assert (found.stiffness.matrix, found.mass.matrix) == ("MATK", "MATM")
    body = read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=deck)
    proof = prove_row_order(body)
    assert (body.n, proof.status, proof.motions) == (28, "proven", 6)
    # Eigenvalues that NX wrote in the results of the same run: all modes of the superelement that it kept.
    theirs = [1.28694275e6, 2.69528225e6, 4.37740550e6, 8.33807000e6]
    ours = la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:10]
    np.testing.assert_allclose(ours, theirs, rtol=1e-6)
    grown, reason = with_inner_grids(body, path, deck)
    assert reason == ""
    found = modal_integrals(grown, np.eye(28))
    scale = np.sqrt(body.M.diagonal())
    trace = np.einsum("iiab->ab", found.phi_phi)
    assert np.abs((trace - body.M.toarray()) / np.outer(scale, scale)).max() < 1e-13
