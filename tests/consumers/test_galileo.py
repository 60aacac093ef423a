"""Two flexible bodies on one hinge in Exudyn, against cmsreduce's own assembly at every angle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.model import Damping, FrameCondition, ModalComponent
from tests.simulate.scenes import hinged, joint, simulate

pytest.importorskip("exudyn")
from tests.consumers.galileo import Galileo

pytestmark = pytest.mark.exudyn

# Six rigid motions of the pair and the spin of one body on the other.
RIGID = 7
BAND = 2 * np.pi * 10.0


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Galileo:
    return Galileo(tmp_path_factory.mktemp("galileo"))


@pytest.mark.parametrize("number", range(4))
def test_frequencies_at_frozen_angles(pair: Galileo, number: int) -> None:
    """Exudyn's linearisation of the turned pair is the system that cmsreduce assembles at that angle."""
    setting = pair.settings[number]
    expected = pair.omega(pair.ranked, setting)
    assert expected.size == 29
    scene, _, _ = pair.scene(pair.ranked, pair.angle(setting))
    found = scene.frequencies()
    assert found[RIGID - 1] < 1e-4 * found[RIGID]
    np.testing.assert_allclose(found[RIGID:], expected, rtol=1e-8)


def test_reduced_bodies_against_full_ones(pair: Galileo) -> None:
    """At an angle far from the one that the files were written at, every frequency in the band from above."""
    setting = pair.settings[3]
    full = pair.omega(None, setting)
    scene, _, _ = pair.scene(pair.reduced, pair.angle(setting))
    found = scene.frequencies()[RIGID:]
    inside = full < BAND
    assert inside.sum() == 58
    ratio = found[: full.size][inside[: found.size]] / full[inside]
    # Craig-Bampton modes to twice the band: from above, and three times what is measured (benchmarks/consumers.md).
    assert ratio.min() > 1 - 1e-8
    assert ratio.max() < 1 + 1e-4


def test_a_slew_against_our_own_simulation(pair: Galileo, tmp_path: Path) -> None:
    """Deflection of the boom's tip over time, by 19 + 10 modes: two programs, one component file a body.

    Exudyn's generalised alpha errs by the square of the step, 2.4e-4 with 4000 steps: two runs are extrapolated.
    """
    seconds = 0.4

    def torque(t: float) -> float:
        return TORQUE * np.sin(2 * np.pi * t / seconds)

    def by_exudyn(steps: int) -> np.ndarray:
        scene, stator, rotor = pair.scene(pair.ranked, 0.0)
        scene.turn(rotor, lambda t: (0.0, 0.0, torque(t)))
        scene.turn(stator, lambda t: (0.0, 0.0, -torque(t)))
        tip = scene.watch_point(rotor, pair.mesh_node("rotor", BOOM_TIP), "DisplacementLocal")
        scene.move(seconds, steps, modified=True)
        return scene.seen(tip)[:: steps // 10, 1:]

    found = (4 * by_exudyn(4000) - by_exudyn(2000)) / 3
    bearing = joint("spin", "stator.spin_bearing", "rotor.spin_bearing")
    frames = dict.fromkeys(("stator", "rotor"), FrameCondition("clamped", "spin_bearing"))
    bodies = [undamped(pair.ranked[name]) for name in ("stator", "rotor")]
    own = hinged(bodies, [bearing], tmp_path, frames=frames)
    motion = simulate(own, seconds, points=10, efforts={"spin.5": torque}, accuracy=1e-5)
    marker = motion.system.bodies[1].markers[str(BOOM_TIP)]
    expected = motion.modal["rotor"] @ marker.translation.T
    assert np.linalg.norm(found - expected) < 1e-4 * np.linalg.norm(expected)


def undamped(component: ModalComponent) -> ModalComponent:
    """The body without damping, which Exudyn's file does not hold."""
    return replace(component, body=replace(component.body, damping=Damping()), zeta=np.zeros_like(component.zeta))


SECONDS, STEPS, TORQUE = 4.0, 200, 120.0
BOOM_TIP = 1306


def slew(pair: Galileo, components: Mapping[str, ModalComponent]) -> tuple[np.ndarray, float]:
    """Path of the boom's tip in the rotor's frame (steps, 3) while the motor turns the bearing, and by how much."""
    scene, stator, rotor = pair.scene(components, 0.0)

    def torque(t: float) -> float:
        return TORQUE * np.sin(2 * np.pi * t / SECONDS)

    scene.turn(rotor, lambda t: (0.0, 0.0, torque(t)))
    scene.turn(stator, lambda t: (0.0, 0.0, -torque(t)))
    rates = [scene.watch_frame(body, "AngularVelocityLocal") for body in (stator, rotor)]
    tip = scene.watch_point(rotor, pair.mesh_node("rotor", BOOM_TIP), "DisplacementLocal")
    scene.move(SECONDS, STEPS, 0.9, modified=True)
    stator_rate, rotor_rate = (scene.seen(sensor)[:, 3] for sensor in rates)
    return scene.seen(tip)[:, 1:], float(abs(np.cumsum(rotor_rate - stator_rate)).max() * SECONDS / STEPS)


def test_a_slew_by_few_modes_and_by_many(pair: Galileo) -> None:
    """Rest to rest through a large angle: 19 + 10 modes against 74 + 10, rms over rms."""
    few, turned = slew(pair, pair.ranked)
    many, _ = slew(pair, pair.reduced)
    assert np.rad2deg(turned) > 70
    # The tip of the boom moves by half a metre; three times what is measured (benchmarks/consumers.md).
    assert abs(many).max() > 0.4
    assert np.linalg.norm(few - many) < 2e-4 * np.linalg.norm(many)
