"""A four-bar linkage with a flexible coupler in Exudyn: frozen against finite elements, moving against `simulate`.

A mesh node of a beam has no rotation in Exudyn: crank and rocker, clamped at the ground, hang on its hinges, and the
coupler between them on balls. In the plane that is the four-bar; out of it the coupler is free to turn about itself.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.mechanics import floating_frame
from cmsreduce.model import FrameCondition, ModalComponent
from tests.consumers.bodies import modes, npz
from tests.simulate.four_bar import bars
from tests.simulate.scenes import hinged, joint, rigid_part, simulate

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import Body, ExudynScene

pytestmark = pytest.mark.exudyn

HINGE = 5
CLAMPED = {"crank": "a", "rocker": "d"}
# Mesh nodes count from 0; the links have four elements.
END, MIDDLE = 4, 2


def placed(scene: ExudynScene, folder: Path, component: ModalComponent) -> Body:
    """A body where it is built: its frame at the ground's hinge, or the mean axes of the coupler."""
    at = CLAMPED.get(component.name)
    condition = FrameCondition("mean-axis") if at is None else FrameCondition("clamped", at)
    found = floating_frame(component.body, component.Phi, component.rigid_count, condition)
    return scene.add(npz(folder, component, found), positionRef=found.origin, rotationMatrixRef=found.axes.T)


def linkage(folder: Path, links: list[ModalComponent]) -> tuple[ExudynScene, list[Body]]:
    scene = ExudynScene()
    crank, coupler, rocker = parts = [placed(scene, folder, link) for link in links]
    for link, at in ((crank, (0, 0, 0)), (rocker, (1, 0, 0))):
        scene.join(scene.ground_at(at), link.marker, free=[HINGE])
    # The rocker runs from c to d, and is held at d.
    for first, node, second, other in ((crank, END, coupler, 0), (coupler, END, rocker, 0)):
        scene.ball(scene.marker_at(first, node), scene.marker_at(second, other))
    return scene, parts


def test_frozen_frequencies(tmp_path: Path) -> None:
    """All links flexible: against finite elements of the whole, hinges and balls as shared dofs, by scipy."""
    parts = bars()[1:]
    scene, _ = linkage(tmp_path, [modes(part) for part in parts])
    K, M = (la.block_diag(*(getattr(part, name).toarray() for part in parts)) for name in ("K", "M"))
    n, eye = parts[0].n, np.eye(3 * parts[0].n)
    pinned = [eye[first + k] for first in (0, 3 * n - 6) for k in range(5)]
    balls = [eye[end - 6 + k] - eye[end + k] for end in (n, 2 * n) for k in range(3)]
    N = la.null_space(np.array([*pinned, *balls]))
    lam = la.eigh(N.T @ K @ N, N.T @ M @ N, eigvals_only=True)
    found = scene.frequencies()
    # The mechanism, and the coupler about itself.
    rigid = 2
    assert abs(lam[:rigid]).max() < 1e-8 * lam[rigid]
    np.testing.assert_allclose(found[-(lam.size - rigid) :], np.sqrt(lam[rigid:]), rtol=1e-8)


SECONDS = 0.4


def torque(t: float) -> float:
    return 8.0 * float(np.sin(np.pi * t / SECONDS)) ** 2


def test_motion_with_a_flexible_coupler(tmp_path: Path) -> None:
    """A pulse of torque turns the crank: the coupler's middle, by four modes, against `cmsreduce.simulate`."""
    steps = 5000
    whole = {part.name: modes(part) for part in bars()}
    elastic = slice(6, 10)
    kept = {"coupler": np.arange(elastic.start, elastic.stop)}
    # Crank and rocker as good as rigid: their highest mode alone.
    parts = {name: part.truncated(kept.get(name, [part.omega.size - 1])) for name, part in whole.items()}
    scene, (crank, coupler, _) = linkage(tmp_path, [parts[name] for name in ("crank", "coupler", "rocker")])
    scene.turn(crank, lambda t: (0.0, 0.0, torque(t)))
    sensor = scene.watch_point(coupler, MIDDLE)
    scene.move(SECONDS, steps)
    found = scene.seen(sensor)[-1, 1:]
    links = [rigid_part(whole[name]) for name in ("ground", "crank")]
    links += [parts["coupler"], rigid_part(whole["rocker"])]
    joints = [
        joint("a", "ground.a", "crank.a"),
        joint("b", "crank.b", "coupler.b"),
        joint("c", "coupler.c", "rocker.c"),
        joint("d", "ground.d", "rocker.d"),
    ]
    loop = hinged(links, joints, tmp_path, ground=["ground.a"])
    motion = simulate(loop, SECONDS, points=4, efforts={"a.5": torque}, accuracy=1e-3)
    bend = motion.modal["coupler"] @ motion.system.bodies[2].markers[str(MIDDLE + 1)].translation.T
    # More than half a turn, and a coupler that bends by a thousand times what is asserted.
    assert motion.joints["a.rz"][-1] > np.pi and np.linalg.norm(bend[-1]) > 1e-3
    np.testing.assert_allclose(found, motion.point("coupler", MIDDLE + 1)[-1], rtol=0, atol=1e-6)
