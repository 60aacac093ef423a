"""Scalar points on springs: oscillators take part in rigid motion; modes of superelements do not."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import FEModel, rigid_body_shapes
from cmsreduce.read import MatrixSource, prove_row_order, read_body, superelement_matrices
from tests.frames import frame, line, rotation

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5)]
POINT, SPRING, MASS = 900, 2e4, 0.3


@dataclass
class Model:
    """A free frame in which scalar points stand on springs to other dofs."""

    body: FEModel
    K: np.ndarray
    M: np.ndarray
    points: int = 0

    def spring(self, i: int, j: int, rate: float = SPRING) -> None:
        self.K[np.ix_([i, j], [i, j])] += rate * np.array([[1, -1], [-1, 1]])

    def point(self, at: int, rate: float = SPRING, mass: float = MASS) -> int:
        self.K, self.M = la.block_diag(self.K, 0.0), la.block_diag(self.M, mass)
        self.points += 1
        self.spring(at, len(self.K) - 1, rate)
        return len(self.K) - 1

    def read(self, folder: Path) -> FEModel:
        assert self.body.nodes is not None
        for name in "KM":
            scipy.io.mmwrite(folder / f"{name}.mtx", sp.coo_array(getattr(self, name)), precision=17)
        labels = [*self.body.dofs.labels, *(f"{POINT + k}.0" for k in range(self.points))]
        (folder / "rows.txt").write_text("\n".join(labels) + "\n")
        turned = self.body.nodes.frame[2]
        axes = ",".join(repr(float(x)) for x in turned[2])
        more = ",".join(repr(float(x)) for x in turned[0])
        grids = [
            f"GRID,{id},,{x!r},{y!r},{z!r},{10 if k == 2 else 0}"
            for k, (id, (x, y, z)) in enumerate(zip(self.body.nodes.id, self.body.nodes.xyz.tolist(), strict=True))
        ]
        system = [f"CORD2R,10,0,0.,0.,0.,{axes}", f"+,{more}"]
        spoint = [f"SPOINT,{POINT + k}" for k in range(self.points)]
        (folder / "deck.bdf").write_text("\n".join([*grids, *system, *spoint]) + "\n")
        K, M = (MatrixSource(folder / f"{name}.mtx") for name in "KM")
        return read_body("tank", stiffness=K, mass=M, geometry=folder / "deck.bdf", rows=folder / "rows.txt")


@pytest.fixture
def model() -> Model:
    """Node 3 has displacements along axes of its own."""
    body, axes = frame("tank", XYZ, BARS), rotation([1, 2, 3], 0.7)
    assert body.nodes is not None
    T, frames = np.eye(body.n), body.nodes.frame.copy()
    T[12:18, 12:18], frames[2] = np.kron(np.eye(2), axes), axes
    K, M = T @ body.K @ T.T, T @ body.M @ T.T
    body = replace(body, K=sp.csc_array(K), M=sp.csc_array(M), nodes=replace(body.nodes, frame=frames))
    return Model(body, K, M)


def row(model: Model, node: int, component: int) -> int:
    return int(model.body.dofs.rows(node, [component])[0])


@pytest.mark.parametrize(("node", "component"), [(2, 1), (4, 3), (3, 2), (3, 5), (5, 4)])
def test_an_oscillator_on_one_dof_moves_with_the_body(model, tmp_path, node, component):
    """The point has the motion of the dof that its spring leads to, in turned displacement frames, too."""
    model.point(row(model, node, component))
    body = model.read(tmp_path)
    assert prove_row_order(body).motions == 6
    R = rigid_body_shapes(body.dofs, body.nodes)
    np.testing.assert_allclose(R[-1], R[row(model, node, component)], atol=1e-12)
    assert abs(body.K @ R).max() < 1e-9 * abs(body.K).max()
    # Six motions without force, and the mass that moves with the body includes that of the point.
    assert rigid_body_modes(body.K, body.M, R, body.rounding, "tank").shape[1] == 6
    assert body.remarks == (f"tank: scalar points on springs move with the body, as dofs {POINT}.{component}",)
    before = rigid_body_shapes(model.body.dofs, model.body.nodes)
    expected = before.T @ (model.body.M @ before) + MASS * np.outer(R[-1], R[-1])
    np.testing.assert_allclose(R.T @ (body.M @ R), expected, atol=1e-9)


def test_a_chain_of_points_and_a_point_between_two_grids(model, tmp_path):
    first = model.point(row(model, 2, 1))
    model.point(first, rate=3e3)
    # The middle of a spring between two grids along their line.
    between = model.point(row(model, 1, 1), rate=1e4)
    model.spring(between, row(model, 2, 1), 3e4)
    body = model.read(tmp_path)
    assert prove_row_order(body).motions == 6
    R = rigid_body_shapes(body.dofs, body.nodes)
    np.testing.assert_allclose(R[-3:, :3], [[1, 0, 0]] * 3, atol=1e-12)
    assert abs(body.K @ R).max() < 1e-9 * abs(body.K).max()


def test_modes_of_a_superelement_and_free_points_stay_scalar(model, tmp_path):
    """Generalised coordinates share mass with the nodes, and their stiffness is a diagonal entry."""
    k = model.point(row(model, 2, 1), rate=0.0, mass=1.0)
    model.K[k, k] = 5e6
    model.M[k, :12] = model.M[:12, k] = 0.01
    body = model.read(tmp_path)
    assert body.dofs.labels[-1] == f"{POINT}.0"
    assert len(body.nodes) == 5
    assert prove_row_order(body).motions == 6


@pytest.mark.parametrize("case", ["second spring to the ground", "springs along two axes", "gain of 2"])
def test_a_point_that_holds_the_body_is_refused(model, tmp_path, case):
    """Exchanged signs or factors in the row of a point are no oscillator either."""
    k = model.point(row(model, 2, 1))
    if case == "second spring to the ground":
        model.K[k, k] += 0.5 * SPRING
    elif case == "springs along two axes":
        model.spring(k, row(model, 2, 2))
    else:
        model.K[k, :-1] *= 2
        model.K[:-1, k] *= 2
    with pytest.raises(DofMapError, match="900"):
        model.read(tmp_path)


def test_a_node_without_a_place_is_named_as_before(model, tmp_path):
    """The message of the body, not that of the search for points."""
    model.point(row(model, 2, 1))
    model.read(tmp_path)
    deck = tmp_path / "deck.bdf"
    deck.write_text("\n".join(line for line in deck.read_text().splitlines() if not line.startswith("GRID,4,")))
    K, M = (MatrixSource(tmp_path / f"{name}.mtx") for name in "KM")
    with pytest.raises(DofMapError, match="1 nodes have rows in the matrices but no coordinates"):
        read_body("tank", stiffness=K, mass=M, geometry=deck, rows=tmp_path / "rows.txt")


def punch(path: Path, *, component: int = 0, cut: bool = False, massless: tuple[int, ...] = ()) -> np.ndarray:
    """Write a superelement of a bar, one file as EXTSEOUT(DMIGPCH) has it; its frequencies in Hz.

    ``component`` is that of its three modes, ``massless`` are rows without mass; a file that is ``cut`` ends after the
    last column but one.
    """
    bar = line("bar", [0, 0, 0], [0.6, 0.1, 0], 2)
    K, M = bar.K.toarray(), bar.M.toarray()
    inner, face = np.arange(6, 12), np.r_[0:6, 12:18]
    shapes = la.eigh(K[np.ix_(inner, inner)], M[np.ix_(inner, inner)])[1][:, :3]
    T = np.zeros((18, 15))
    T[face, np.arange(12)] = 1
    T[np.ix_(inner, np.arange(12))] = -la.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, face)])
    T[np.ix_(inner, np.arange(12, 15))] = shapes
    K, M = T.T @ K @ T, T.T @ M @ T
    M[list(massless)], M[:, list(massless)] = 0, 0
    labels = [(node, c) for node in (1, 3) for c in range(1, 7)] + [(POINT + k, component) for k in range(3)]
    cards = ["BEGIN SUPER 5", f"EXTRN,1,123456,3,123456,{POINT},THRU,{POINT + 2}", "+,0"]
    cards += ["GRID,1,,0.,0.,0.", "GRID,3,,.6,.1,0.", f"SPOINT,{POINT},THRU,{POINT + 2}"]
    for name, A in (("KAAX", K), ("MAAX", M)):
        cards.append(f"DMIG,{name},0,6,2,0")
        for j in range(14 if cut and name == "MAAX" else 15):
            rows = np.flatnonzero(A[: j + 1, j])
            cards += [f"DMIG,{name},{_dof(labels[j])},,{_dof(labels[i])},{A[i, j]:.15e}" for i in rows]
    path.write_text("\n".join(cards) + "\n")
    at = np.setdiff1d(np.arange(15), massless)
    gone = np.array(massless, dtype=int)
    if gone.size:
        K = K[np.ix_(at, at)] - K[np.ix_(at, gone)] @ la.solve(K[np.ix_(gone, gone)], K[np.ix_(gone, at)])
    return np.sqrt(abs(la.eigvalsh(K, M[np.ix_(at, at)]))) / (2 * np.pi)


def _dof(label: tuple[int, int]) -> str:
    return f"{label[0]},{label[1]}"


@pytest.mark.parametrize(("component", "massless"), [(0, ()), (1, ()), (0, (3, 9))])
def test_superelements_by_points_with_a_component_and_with_rows_without_mass(
    tmp_path: Path, component: int, massless: tuple[int, ...]
) -> None:
    expected = punch(tmp_path / "x.pch", component=component, massless=massless)
    found = superelement_matrices(tmp_path / "x.pch")
    body = read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=tmp_path / "x.pch")
    assert (body.dofs.component == 0).sum() == 3
    lam = la.eigvals(body.K.toarray(), body.M.toarray())
    lam = np.sort(lam[np.isfinite(lam)].real)[6 : len(expected)]
    np.testing.assert_allclose(np.sqrt(lam) / (2 * np.pi), expected[6:], rtol=1e-9)


@pytest.mark.parametrize("named", [True, False])
def test_a_superelement_that_is_cut_before_its_last_mode_is_refused(tmp_path: Path, named: bool) -> None:
    """The rest is a whole superelement of another body, whose last mode has no mass: 290 Hz of it became 301.

    OptiStruct names the modes in no card.
    """
    expected, deck = punch(tmp_path / "x.pch"), tmp_path / "x.pch"
    found = superelement_matrices(tmp_path / "x.pch")
    if not named:
        deck = tmp_path / "x.fem"
        deck.write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,3,,.6,.1,0.\nASET1,123456,1,3\nENDDATA\n")
    body = read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=deck)
    assert body.sets["q"].size == 3
    lam = la.eigvalsh(body.K.toarray(), body.M.toarray())[6:]
    np.testing.assert_allclose(np.sqrt(lam) / (2 * np.pi), expected[6:], rtol=1e-9)
    punch(tmp_path / "x.pch", cut=True)
    with pytest.raises(MatrixError, match=r"MAAX.* has no entries for 1 modes .* the first is 902\.0"):
        read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=deck)
