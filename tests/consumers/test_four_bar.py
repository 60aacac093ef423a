"""A four-bar linkage with a flexible coupler in Exudyn: frozen against finite elements, moving against the example.

A mesh node of a beam has no rotation in Exudyn: crank and rocker, clamped at the ground, hang on its hinges, and the
coupler between them on balls. In the plane that is the four-bar; out of it the coupler is free to turn about itself.
"""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.mechanics import floating_frame
from cmsreduce.model import FrameCondition, ModalComponent
from cmsreduce.write import write_component
from tests.consumers.bodies import modes, npz
from tests.examples.test_cross_checks import bars

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import Body, ExudynScene

pytestmark = pytest.mark.exudyn

HINGE = 5
CLAMPED = {"crank": "a", "rocker": "d"}
EXAMPLES = Path(__file__).parents[2] / "examples"
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
    """A pulse of torque turns the crank: the coupler's middle, by four modes, against the example's integration."""
    steps, rough = 5000, 80
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
    tree = example(tmp_path, whole)
    s, h = tree.rest(), SECONDS / rough
    for number in range(rough):
        s = tree.step(s, number * h, h, lambda t, _: np.array([torque(t), 0.0, 0.0]))
    place, _, _ = tree.motions(s)[2]
    middle = whole["coupler"].body.nodes.xyz[MIDDLE]
    shape = parts["coupler"].Phi[whole["coupler"].body.dofs.node == MIDDLE + 1][:3, elastic] @ s.q
    expected = place + s.axes[2] @ (middle + shape)
    # More than half a turn, and a coupler that bends by a thousand times what is asserted.
    assert s.angles[0] > np.pi and np.linalg.norm(shape) > 1e-3
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)


def example(folder: Path, whole: dict[str, ModalComponent]) -> Any:
    """The same linkage of `examples/linkage.py`, from component files about the basic frame."""
    sys.path.insert(0, str(EXAMPLES))
    try:
        module = importlib.import_module("linkage")
    finally:
        sys.path.remove(str(EXAMPLES))
    bodies = []
    for name in ("ground", "crank", "coupler", "rocker"):
        path = folder / f"{name}_basic.h5"
        write_component(path, whole[name], nodes=(), inputs={}, outputs={}, checks=(), provenance={}, all_nodes=True)
        bodies.append(module.load(path).cut(4 if name == "coupler" else 0))
    return module.four_bar(bodies)
