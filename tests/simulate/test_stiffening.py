"""Stress of a spinning beam: published frequencies, energy, and what happens without geometric stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.errors import SimulationError
from cmsreduce.model import MultibodyScene
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.simulate import MultibodySystem, scene_system, simulate_scene
from cmsreduce.simulate.movements import Movement, PointMotion
from tests.spinning_beam import BEAM, LENGTH, PIPELINE, write_beam

BASE = "  base:\n    rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}\n    interfaces: {{a: {{position: [0, 0, 0]}}}}\n"
AXLE = "  joints: {{spin: {{connect: [base.a, beam.root], free: [rz]}}}}\n"
TEXT = (
    PIPELINE.replace("    damping: {{modal: 0.005}}\n", "")
    .replace("scene:\n", f"{BASE}scene:\n")
    .replace("ground: beam.root", "ground: base.a")
    .replace("  actuators:", f"{AXLE}  actuators:")
    .replace(", tip: {{node: {tip}}}", "")
    .replace("lift: {{at: beam.tip, force: [0, 1, 1]}}", "motor: {{joint: spin, dof: rz}}")
    .replace("beam.tip", "beam.{tip}")
    .replace("bars: all", "bars: [all, force {tip}]")
    .replace("cutoff: 3", "cutoff: 2")
    .replace("verify: {{frf: {{points: 20}}}}\n", "")
    .replace("[hdf5]}}", "[hdf5], frame: {{kind: clamped, at: root}}}}")
)
# Ten times the unit of frequency of flapping, at which the published frequency is given.
UNIT = np.sqrt(BEAM.E * BEAM.Iy / (BEAM.rho * BEAM.A * LENGTH**4))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> MultibodyScene:
    folder = tmp_path_factory.mktemp("spun")
    path = write_beam(folder, text=TEXT)
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    return multibody_scene(folder / "out")


@pytest.mark.parametrize(("spin", "published"), [(0.0, 3.5160), (4.0, 5.5850), (10.0, 11.2023)])
def test_flapping_of_a_beam_that_spins(scene: MultibodyScene, spin: float, published: float) -> None:
    """Wright, Smith, Thresher and Wang, J. Appl. Mech. 49 (1982): clamped at the axle, across the plane of the spin."""
    bodies = floating_bodies(scene)
    system = scene_system(scene, bodies)
    base = system.start({0: spin * UNIT})
    k, rates = bodies["beam"].k, slice(system.first_speed + 6, system.first_speed + 6 + bodies["beam"].k)

    def accelerations(q: np.ndarray) -> np.ndarray:
        y = base.copy()
        y[system.modal[0]] = q
        return system.rate(0.0, y)[rates]

    small = 1e-6
    A = -np.array([accelerations(small * e) - accelerations(-small * e) for e in np.eye(k)]).T / (2 * small)
    out_of_plane = abs(bodies["beam"].markers["21"].translation[2]) > 1e-3
    lowest = np.sqrt(np.linalg.eigvals(A[np.ix_(out_of_plane, out_of_plane)]).real.min())
    assert lowest / UNIT == pytest.approx(published, rel=1e-3)


@pytest.mark.parametrize(("share", "stands"), [(0.99, True), (1.01, False)])
def test_a_pressed_beam_buckles_under_eulers_load(scene: MultibodyScene, share: float, stands: bool) -> None:
    """A force that keeps its direction presses the tip of the clamped beam: pi^2 E I / 4 L^2."""
    bodies = floating_bodies(scene)
    plain = scene_system(scene, bodies)
    press = PointMotion(0, bodies["beam"].markers["21"], np.array([-1.0, 0, 0, 0, 0, 0]))
    places = [(plain.place(number), np.eye(3)) for number in range(2)]
    system = MultibodySystem(plain.bodies, places, plain.connections, [Movement("press", (press,))])
    load = share * np.pi**2 * BEAM.E * BEAM.Iy / (4 * LENGTH**2)
    system.efforts = {0: lambda _: load}
    rates = slice(system.first_speed + 6, system.first_speed + 6 + bodies["beam"].k)
    pushed = []
    for q in 1e-6 * np.eye(bodies["beam"].k):
        y = system.start()
        y[system.modal[0]] = q
        pushed.append((system.rate(0.0, y)[rates] - system.rate(0.0, system.start())[rates]) / 1e-6)
    bent = abs(bodies["beam"].markers["21"].translation[2]) > 1e-3
    squares = np.linalg.eigvals(-np.array(pushed).T[np.ix_(bent, bent)]).real
    assert (squares.min() > 0) == stands
    assert abs(squares.min()) < 0.05 * (3.516 * UNIT) ** 2


def test_a_beam_that_spins_and_bends_keeps_its_energy(scene: MultibodyScene) -> None:
    """Stiffness by stress is in the mass matrix, so that what it gives is what it takes."""
    bodies = floating_bodies(scene)
    q = np.zeros(bodies["beam"].k)
    q[:2] = 0.005
    motion = simulate_scene(
        scene, bodies, 0.03, points=2, rates={"spin.rz": 6 * UNIT}, modes={"beam": q}, accuracy=1e-6
    )
    tip = bodies["beam"].deflection(motion.modal["beam"][0])
    assert 0.02 < tip < 0.2
    assert motion.imbalance < 1e-8


def test_without_the_stress_the_same_spin_diverges_with_a_message(scene: MultibodyScene) -> None:
    soft = {name: replace(body, stretch=None) for name, body in floating_bodies(scene).items()}
    q = np.zeros(soft["beam"].k)
    q[:2] = 0.05
    with pytest.raises(SimulationError, match="not positive definite"):
        simulate_scene(scene, floating_bodies(scene), 3.0, modes={"beam": 2 * q})
    with pytest.raises(SimulationError, match=r"grows without bound.*'beam' bends.*geometric_stiffness"):
        simulate_scene(scene, soft, 3.0, rates={"spin.rz": 12 * UNIT}, modes={"beam": q}, points=2, accuracy=1e-3)
