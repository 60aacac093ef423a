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
from cmsreduce.simulate import scene_system, simulate_scene
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
    execute(Run(pipeline, pipeline.output, Silent()), path)
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
