"""One body in three floating frames, loaded by Exudyn: it vibrates and tumbles the same in each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.mechanics import floating_frame
from cmsreduce.model import FEModel, FrameCondition, ModalComponent
from cmsreduce.write import profile_files
from cmsreduce.write.component import in_frame
from tests.consumers.bodies import modes, npz
from tests.frames import BAR, Section, frame

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import ExudynScene

pytestmark = pytest.mark.exudyn

FRAMES = {
    "clamped": FrameCondition("clamped", "root"),
    "mean axes": FrameCondition("mean-axis"),
    "chord": FrameCondition("chord", "root", "tip"),
}


def bent(section: Section = BAR) -> FEModel:
    """Bars out of any plane, with a lump."""
    xyz = [[0.3, 0, 0.1], [1, 0, 0], [1, 1, 0], [1.2, 1, 1], [2, 1.5, 0.6]]
    return frame("bent", xyz, [(1, 2), (2, 3), (3, 4), (4, 5)], {"root": 1, "tip": 5}, masses={3: 1.5}, section=section)


@pytest.fixture(scope="module")
def component() -> ModalComponent:
    return modes(bent())


def written(folder: Path, component: ModalComponent, kind: str) -> Path:
    found = floating_frame(component.body, component.Phi, component.rigid_count, FRAMES[kind])
    return npz(folder, component, found)


@pytest.mark.parametrize("kind", FRAMES)
def test_frequencies_of_the_free_body(component: ModalComponent, tmp_path: Path, kind: str) -> None:
    """By scipy, of the finite elements: the frame's inertia and its coupling with the modes make up for the frame."""
    K, M = (A.toarray() for A in (component.body.K, component.body.M))
    scene = ExudynScene()
    scene.add(written(tmp_path, component, kind))
    expected = np.sqrt(la.eigh(K, M, eigvals_only=True)[6:])
    np.testing.assert_allclose(scene.frequencies()[6:], expected, rtol=1e-8)


def test_frequencies_with_the_clamped_interface_held(component: ModalComponent, tmp_path: Path) -> None:
    K, M = (A.toarray()[6:, 6:] for A in (component.body.K, component.body.M))
    scene = ExudynScene()
    body = scene.add(written(tmp_path, component, "clamped"))
    scene.join(scene.ground, body.marker)
    np.testing.assert_allclose(scene.frequencies(), np.sqrt(la.eigh(K, M, eigvals_only=True)), rtol=1e-8)


def test_a_profile_clamps_a_body_that_was_written_free(component: ModalComponent, tmp_path: Path) -> None:
    """The frame is changed from the component file alone, and back again: the held and the free finite elements."""
    npz(tmp_path, component)
    K, M = (A.toarray() for A in (component.body.K, component.body.M))
    made = profile_files(tmp_path / "bent.h5", "exudyn", tmp_path, at="root")
    held = ExudynScene()
    body = held.add(made.paths[0])
    held.join(held.ground, body.marker)
    expected = np.sqrt(la.eigh(K[6:, 6:], M[6:, 6:], eigvals_only=True))
    np.testing.assert_allclose(held.frequencies(), expected, rtol=1e-8)
    free = ExudynScene()
    free.add(profile_files(in_frame(made.body, FRAMES["mean axes"]), "exudyn", tmp_path).paths[0])
    np.testing.assert_allclose(free.frequencies()[6:], np.sqrt(la.eigh(K, M, eigvals_only=True)[6:]), rtol=1e-8)


def test_static_deflection_of_the_clamped_body(component: ModalComponent, tmp_path: Path) -> None:
    """The tip under a force, the root held: by the stiffness matrix."""
    force = np.array([0.02, -0.03, 0.01])
    load = np.zeros(component.body.n - 6)
    load[-6:-3] = force
    expected = np.linalg.solve(component.body.K.toarray()[6:, 6:], load)[-6:-3]
    scene = ExudynScene()
    body = scene.add(written(tmp_path, component, "clamped"))
    scene.join(scene.ground, body.marker)
    scene.pull(body, 4, force)
    scene.settle()
    np.testing.assert_allclose(scene.local_displacement(body, 4), expected, rtol=1e-9, atol=1e-12)


def test_a_slew_is_the_same_from_a_clamp_and_from_mean_axes(tmp_path: Path) -> None:
    """Thrown at a spin and pulled at its tip, the body turns by more than a radian; frames differ, its nodes do not.

    Without stress, a body seen from a clamp softens by the square of its spin over its lowest frequency there, seen
    from mean axes by less: the spin is slow.
    """
    slow = modes(bent(Section(Iy=1e-7, Iz=2e-7)), 200.0)
    spin, speed, force = np.array([0.2, -0.15, 0.45]), np.array([0.1, 0.2, 0.0]), [0.0, 0.05, 0.07]
    seconds, steps = 2.5, 1500
    found, bends = {}, {}
    for kind in ("clamped", "mean axes"):
        seen = floating_frame(slow.body, slow.Phi, slow.rigid_count, FRAMES[kind])
        scene = ExudynScene()
        (tmp_path / kind).mkdir()
        start = {"initialVelocity": speed + np.cross(spin, seen.origin), "initialAngularVelocity": spin}
        body = scene.add(npz(tmp_path / kind, slow, seen), positionRef=seen.origin, **start)
        scene.pull(body, 4, force)
        sensors = [scene.watch_point(body, node) for node in (0, 2, 4)]
        frame, bend = scene.watch_frame(body, "RotationMatrix"), scene.watch_point(body, 4, "DisplacementLocal")
        scene.move(seconds, steps)
        found[kind] = np.hstack([scene.seen(sensor)[:, 1:] for sensor in sensors])
        bends[kind] = scene.seen(bend)[:, 1:]
        turned = scene.seen(frame)[-1, 1:].reshape(3, 3)
        assert np.arccos((np.trace(turned) - 1) / 2) > 1.0
    # The frames see different bending, of many times what is asserted.
    assert abs(bends["clamped"] - bends["mean axes"]).max() > 2e-5
    np.testing.assert_allclose(found["mean axes"], found["clamped"], rtol=0, atol=1e-6)
