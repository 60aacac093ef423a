"""The scene of a run in time: what must stay constant does, and small motions are those of the assembled system."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la

import cmsreduce as cms
from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.simulate import scene_system
from tests.pipeline.study import arm, panel, write_body

PIPELINE = """\
name: pair
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 5}}}}
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}}}
scene:
  band: 60 Hz
  joints: {{hinge: {{connect: [arm.tip, panel.root], free: [ry]}}}}
  articulation: {{hinge: [0, 40 deg]}}
  actuators: {{motor: {{joint: hinge, dof: ry}}}}
  sensors: {{gyro: {{at: arm.root, measure: [rx, ry, rz], rate: true}}, angle: {{joint: hinge, dof: ry}}}}
reduce: {{method: craig-bampton, cutoff: 15}}
balance: {{rank: frequency, keep: {{modes: 2}}}}
write: {{formats: [hdf5]}}
"""
PROBE = "probe: {{at: panel.4, measure: z}}, angle: {{"


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Component files and system of an arm with a panel hinged to it, floating."""
    folder = tmp_path_factory.mktemp("pair")
    for body in (arm(), panel()):
        write_body(folder, body)
    path = folder / "pair.yaml"
    path.write_text(PIPELINE.format(output=folder / "out"))
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    return folder / "out"


def test_free_motion_keeps_energy_and_momentum(run_dir: Path) -> None:
    """Tumbling with the panel swinging and both bodies vibrating."""
    start = {"velocity": [0.1, -0.2, 0.3], "spin": [4.0, -5.0, 6.0], "rates": {"hinge.ry": 8.0}}
    shapes = {"arm": [2e-4, -1e-4], "panel": [3e-4, 2e-4]}
    motion = cms.simulate(run_dir, 0.05, **start, modes=shapes, points=1, accuracy=3e-7)
    assert abs(motion.joints["hinge.ry"][-1]) > 0.2
    assert motion.energy[0, 1] > 1e-6 * motion.energy[0, 0]
    assert motion.imbalance < 1e-8
    assert abs(motion.momentum - motion.momentum[0]).max() < 1e-8 * abs(motion.momentum[0]).max()


def test_modal_coordinates_at_the_start_are_those_asked_for(run_dir: Path) -> None:
    """The bodies are placed so that the hinge closes, and keep their deflections."""
    shapes = {"arm": [2e-2, -1e-2], "panel": [3e-2, 2e-2]}
    motion = cms.simulate(run_dir, 1e-4, modes=shapes, points=1)
    for name, q in shapes.items():
        np.testing.assert_allclose(motion.modal[name][0], q, rtol=1e-12)
    gap = motion.point("arm", 5) - motion.point("panel", 1)
    assert abs(gap).max() < 1e-12


def test_bent_bodies_let_go_move_as_the_assembled_system_does(tmp_path: Path) -> None:
    """Sensors begin at the deflections, and the spring of the hinge is at rest; both began at zero, bent or not."""
    for body in (arm(), panel()):
        write_body(tmp_path, body)
    text = PIPELINE.replace("free: [ry]}}", "free: [ry], stiffness: {{ry: 300}}}}").replace("angle: {{", PROBE)
    path = tmp_path / "pair.yaml"
    path.write_text(text.format(output=tmp_path / "out"))
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    shapes = {"arm": [2e-5, -1e-5], "panel": [3e-5, 2e-5]}
    motion = cms.simulate(tmp_path / "out", 0.02, modes=shapes, points=10)
    with h5py.File(tmp_path / "out" / "system.h5") as file:
        K, M, C, T = (file[f"configuration_0/{name}"][()] for name in ("K", "M", "C1", "T"))
    # Six rigid motions, then the elastic modes of each body.
    elastic = np.r_[6:8, T.shape[0] // 2 + 6 : T.shape[0] // 2 + 8]
    lam, X = la.eigh(K, M)
    lam[:6] = 0.0
    # At the deflections, the hinge not turned, and no rigid motion of both.
    rows = np.vstack([T[elastic] @ X, C[4:] @ X])
    a = np.linalg.solve(rows[:, 6:], [*shapes["arm"], *shapes["panel"], 0.0])
    expected = (C[3:] @ X[:, 6:]) @ (a[:, None] * np.cos(np.sqrt(lam[6:, None]) * motion.time))
    for name, values in zip(("probe", "angle"), expected, strict=True):
        np.testing.assert_allclose(motion.sensors[name], values, rtol=0, atol=2e-3 * abs(values).max())


def test_a_slew_conserves_what_it_should(run_dir: Path) -> None:
    """The motor is inside: momentum stays zero, and energy is the motor's work; a rate gyro sees the turn."""
    motion = cms.simulate(run_dir, 0.1, efforts={"motor": cms.Slew(1.5, 0.1)}, points=5, accuracy=1e-6)
    most, mass = motion.energy[:, 0].max(), sum(body.mass for body in motion.system.bodies)
    assert 1.0 < motion.joints["hinge.ry"][-1] < 2.0
    np.testing.assert_allclose(motion.sensors["angle"], motion.joints["hinge.ry"], rtol=0, atol=1e-12)
    assert motion.imbalance < 1e-8
    assert abs(motion.momentum).max() < 1e-8 * np.sqrt(most * mass)
    np.testing.assert_allclose(motion.sensors["gyro.ry"], motion.angular_velocity["arm"][:, 1], rtol=0.2)
    R = motion.rotation["panel"]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (len(R), 1, 1)), atol=1e-12)


@pytest.mark.parametrize("number", [0, 1])
def test_small_motions_have_the_frequencies_of_the_assembled_system(run_dir: Path, number: int) -> None:
    scene = multibody_scene(run_dir, ["hinge=0", "hinge=40"][number])
    system = scene_system(scene, floating_bodies(scene))
    squares, _ = system.linear(system.start())
    with h5py.File(run_dir / "system.h5") as file:
        hertz = file[f"configuration_{number}/frequency_hz"][()]
    np.testing.assert_allclose(np.sqrt(squares[7:]) / (2 * np.pi), hertz[7:], rtol=1e-8)
    assert abs(squares[:7]).max() < 1e-8 * squares[7]


def test_a_run_cut_at_its_scene_is_refused(run_dir: Path) -> None:
    scene = multibody_scene(run_dir)
    with pytest.raises(cms.CmsReduceError, match="configuration"):
        cms.simulate(scene, 1.0, configuration="hinge=40")
    with pytest.raises(cms.CmsReduceError, match="no such folder"):
        cms.simulate(run_dir / "nowhere", 1.0)
