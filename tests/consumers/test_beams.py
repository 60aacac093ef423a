"""Beams in Exudyn: frequencies, static deflection, inertia of nodes that turn, and a spin-up at large rotation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.model import FEModel, ModalComponent
from tests.consumers.bodies import clamped, modes, npz
from tests.consumers.predictions import PlaneBeam
from tests.frames import BAR, line

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import ExudynScene

pytestmark = pytest.mark.exudyn

LENGTH, ELEMENTS = 2.0, 8
ROOT, TIP = "root", ELEMENTS
ROTATIONS = {"x": 0, "y": 1, "z": 2, "rx": 3, "ry": 4, "rz": 5}


def beam() -> FEModel:
    return line("beam", [0, 0, 0], [LENGTH, 0, 0], ELEMENTS, interfaces={ROOT: 1})


def held(body: FEModel, *fixed: int) -> np.ndarray:
    """Elastic frequencies in rad/s of the finite elements with some motions 0..5 of the root held, by scipy."""
    rows = np.setdiff1d(np.arange(body.n), fixed)
    lam = la.eigh(body.K.toarray()[np.ix_(rows, rows)], body.M.toarray()[np.ix_(rows, rows)], eigvals_only=True)
    return np.sqrt(lam[6 - len(fixed) :])


@pytest.fixture(scope="module")
def free_modes() -> ModalComponent:
    return modes(beam())


@pytest.fixture(scope="module")
def clamped_file(free_modes: ModalComponent, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return npz(tmp_path_factory.mktemp("clamped"), clamped(free_modes, ROOT))


def test_free_frequencies(free_modes: ModalComponent, tmp_path: Path) -> None:
    scene = ExudynScene()
    scene.add(npz(tmp_path, free_modes))
    found = scene.frequencies()[6:]
    np.testing.assert_allclose(found, free_modes.omega[6:], rtol=1e-8)
    np.testing.assert_allclose(found[:20], held(beam())[:20], rtol=1e-8)


def test_clamped_frequencies(clamped_file: Path) -> None:
    scene = ExudynScene()
    body = scene.add(clamped_file)
    scene.join(scene.ground, body.marker)
    np.testing.assert_allclose(scene.frequencies(), held(beam(), *range(6)), rtol=1e-8)


@pytest.mark.parametrize(
    ("axis", "force", "expected"),
    [
        (0, 100.0, 100 * LENGTH / (BAR.E * BAR.A)),
        (1, 0.1, 0.1 * LENGTH**3 / (3 * BAR.E * BAR.Iz)),
        (2, 0.1, 0.1 * LENGTH**3 / (3 * BAR.E * BAR.Iy)),
    ],
    ids=["along", "across y", "across z"],
)
def test_static_tip(clamped_file: Path, axis: int, force: float, expected: float) -> None:
    scene = ExudynScene()
    body = scene.add(clamped_file)
    scene.join(scene.ground, body.marker)
    scene.pull(body, TIP, force * np.eye(3)[axis])
    scene.settle()
    assert scene.local_displacement(body, TIP)[axis] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("motion", ROTATIONS)
def test_root_that_is_free_in_one_motion(clamped_file: Path, motion: str) -> None:
    """The frame's inertia and its coupling with the modes decide these frequencies.

    The consistent mass of a beam is not the same along and across it, and its torsion is inertia of rotations alone:
    sums over the translations of nodes with one mass for all directions miss both.
    """
    free = ROTATIONS[motion]
    scene = ExudynScene()
    body = scene.add(clamped_file)
    scene.join(scene.ground, body.marker, free=[free])
    expected = held(beam(), *(set(range(6)) - {free}))
    np.testing.assert_allclose(scene.frequencies()[-expected.size :], expected, rtol=1e-8)


def test_inertia_of_the_frame(clamped_file: Path) -> None:
    """Closed forms, which sums over translations get wrong: by these, no inertia turns about the beam's axis."""
    with np.load(clamped_file, allow_pickle=True) as file:
        mass, inertia = float(file["totalMass"]), file["inertiaLocal"]
        xyz, modal = file["xRef"].reshape(-1, 3), file["massMatrixReduced"]
        shapes = file["modeBasis"]
    line_mass = BAR.rho * BAR.A
    expected = [BAR.rho * (BAR.Iy + BAR.Iz) * LENGTH, line_mass * LENGTH**3 / 3, line_mass * LENGTH**3 / 3]
    assert mass == pytest.approx(line_mass * LENGTH, rel=1e-12)
    np.testing.assert_allclose(inertia, np.diag(expected), rtol=1e-12, atol=1e-12 * expected[2])
    body = beam()
    moving = body.dofs.component <= 3
    M = body.M.toarray()[np.ix_(moving, moving)]
    # What the formulas of Exudyn's own import make of the translational part of the same mass matrix.
    about_z = np.column_stack([-xyz[:, 1], xyz[:, 0], np.zeros(len(xyz))]).ravel()
    assert abs(about_z @ M @ about_z / expected[2] - 1) > 1e-3
    assert abs(np.diag(shapes.T @ M @ shapes) / np.diag(modal) - 1).max() > 0.99


def test_spin_up(tmp_path: Path) -> None:
    """A hinged beam is turned by a pulse of torque through most of a turn, far past small rotations."""
    end, cutoff_hz = 1.5, 100.0
    body = beam()

    def torque(t: float) -> float:
        return 20.0 * np.sin(np.pi * t / 2.0) ** 2

    component = clamped(modes(body, cutoff_hz), ROOT)
    plane = np.isin(body.dofs.component, (2, 6))
    K, M = (A.toarray()[np.ix_(plane, plane)] for A in (body.K, body.M))
    model = PlaneBeam.of(K, M, np.linspace(0, LENGTH, ELEMENTS + 1), count=3)
    np.testing.assert_allclose(component.omega[[1, 3, 5]] ** 2, model.lam, rtol=1e-8)
    times = np.array([0.5, 1.0, 1.5])
    expected = model.spun_up(torque, times)

    steps = 21000
    scene = ExudynScene()
    spun = scene.add(npz(tmp_path, component))
    scene.join(scene.ground, spun.marker, free=[ROTATIONS["rz"]])
    scene.turn(spun, lambda t: (0.0, 0.0, torque(t)))
    tip = scene.watch_point(spun, TIP)
    scene.move(end, steps)
    found = scene.seen(tip)[np.round(times / end * steps).astype(int)]
    np.testing.assert_allclose(found[:, 0], times, rtol=1e-9)
    # The beam does bend, and a rigid one is nowhere near.
    assert abs(expected[:, 2]).max() > 5e-3
    np.testing.assert_allclose(found[:, 1:3], expected[:, :2], rtol=0, atol=1e-6)
