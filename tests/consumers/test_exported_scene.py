"""Scenes that `cmsreduce export` wrote run in Exudyn unedited: small motions as assembled, large ones as predicted."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.errors import WriteError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import multibody_scene
from cmsreduce.write import export_scene
from tests.consumers.predictions import PlaneBeam
from tests.frames import line
from tests.pipeline.study import Log, arm, panel, write_body

pytest.importorskip("exudyn")

pytestmark = pytest.mark.exudyn

# A joint of every kind: two axes with springs, an arm, a slide, a weld, a ring closed by a ball; ground; a copy.
ROBOT = """\
name: robot
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 5, frame: {{axis: x, angle: 25 deg}}}}}}
    damping: {{modal: 0.02}}
  copy: {{like: arm, place: {{at: [0, 0.3, 0], rotate: {{axis: x, angle: 40 deg}}}}}}
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
  base:
    rigid: {{mass: 9, cg: [0, 0, 0.1], inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]}}
    interfaces: {{a: {{position: [0, 0, 0]}}, b: {{position: [0, 0.3, -0.1]}}, feet: {{position: [0, 0, 0.2]}}}}
scene:
  band: 60 Hz
  base: base
  joints:
    shoulder:
      connect: [base.a, arm.root]
      free: [ry, rz]
      stiffness: {{ry: 30 N*m/rad, rz: 20 N*m/rad}}
      damping: {{rz: 0.1 N*m*s/rad}}
      inertia: {{ry: 2e-2 kg*m^2}}
    rail: {{connect: [base.b, copy.root], offset: [0, 0, 0.1], free: [y], stiffness: {{y: 900 N/m}}}}
    wrist:
      connect: [arm.tip, panel.root]
      free: [rx]
      stiffness: {{rx: 3 N*m/rad}}
      damping: {{rx: 0.02 N*m*s/rad}}
      inertia: {{rx: 1e-3 kg*m^2}}
  articulation: [{{wrist: 0}}, {{wrist: 65 deg, rail.y: 0.05}}]
  ground: [base.feet]
  actuators:
    motor: {{joint: wrist, dof: rx}}
    lead: {{joint: rail}}
    push: {{at: arm.3, force: [1, 2, -1]}}
    twist: {{at: panel.5, torque: [0, 1, 1]}}
    cable: {{between: [arm.2, panel.6]}}
    shaped: {{rows: {{arm.3.z: 1.0, panel.6.ry: -0.1}}}}
  sensors:
    station: {{at: arm.3, measure: [y, rz]}}
    speed: {{at: panel.6, measure: [y], rate: true}}
    gyro: {{at: panel.5, measure: [rx, ry], rate: true}}
    turned: {{joint: wrist}}
    slide: {{joint: rail, rate: true}}
    stretch: {{between: [arm.4, panel.6]}}
    sight: {{rows: {{panel.6.x: 1.0, arm.2.ry: -0.3}}}}
reduce: {{cutoff: 3}}
write: {{formats: [hdf5]}}
"""

NAMES = count()


def finished(folder: Path, text: str) -> Path:
    """Run directory of a pipeline."""
    path = folder / "scene.yaml"
    path.write_text(text.format(output=folder / "out"))
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Log()), path, report=False)
    return pipeline.output


def exported(run: Path, folder: Path, configuration: str | None = None) -> ModuleType:
    """The script that was exported, as a module."""
    export_scene(multibody_scene(run, configuration), "exudyn", folder)
    spec = importlib.util.spec_from_file_location(f"exported_{next(NAMES)}", folder / "scene.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("robot")
    for body in (arm(), panel()):
        write_body(folder, body)
    return finished(folder, ROBOT)


@pytest.mark.parametrize("number", [0, 1])
def test_small_motions_are_those_of_the_assembled_system(robot: Path, tmp_path: Path, number: int) -> None:
    """Frequencies of the script's own linearisation, and every sensor's answer to every actuator."""
    with h5py.File(robot / "system.h5") as file:
        system = {name: item[()] for name, item in file[f"configuration_{number}"].items() if hasattr(item, "shape")}
        name = file[f"configuration_{number}"].attrs["name"]
    script = exported(robot, tmp_path / "exudyn", name)
    for k, actuator in enumerate(script.LAWS):
        script.LAWS[actuator] = pulse(1e-4 * (1 + k), 0.15 / (1 + k % 3))
    scene = script.build()
    scene.mbs.Assemble()
    found = np.sqrt(np.sort(scene.mbs.ComputeODE2Eigenvalues(useAbsoluteValues=True)[0])) / (2 * np.pi)
    expected = system["frequency_hz"]
    # Exudyn differentiates springs numerically.
    np.testing.assert_allclose(found[-expected.size :], expected, rtol=1e-6)
    times, seen, _ = scene.simulate(0.2, 5e-4, 1e-11)
    answer = linear(system, [script.LAWS[name] for name in script.LAWS], times)
    assert [*scene.channels] == [name.decode() for name in system["outputs"]]
    apart = np.sqrt(((seen - answer) ** 2).mean(axis=0) / (answer**2).mean(axis=0))
    # The rest falls with the square of the step, from 2e-2 at 1 ms.
    assert apart.max() < 1e-2, dict(zip(scene.channels, apart, strict=True))


def pulse(size: float, period: float) -> Callable[[float], float]:
    return lambda t: size * float(np.sin(np.pi * t / period) ** 2) if t < period else 0.0


def linear(system: dict[str, Any], laws: list[Callable[[float], float]], times: np.ndarray) -> np.ndarray:
    """Outputs of M x'' + D x' + K x = B u from rest, by exact steps of a u that is linear in each."""
    M, K, B = system["M"], system["K"], system["B"]
    n, D = len(M), system.get("D", np.zeros_like(M))
    lu = la.cho_factor(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.cho_solve(lu, K), -la.cho_solve(lu, D)]])
    G = np.vstack([np.zeros((n, B.shape[1])), la.cho_solve(lu, B)])
    h, u = times[1] - times[0], np.array([[law(t) for law in laws] for t in times])
    m = G.shape[1]
    step = la.expm(h * np.block([[A, G, np.zeros_like(G)], [np.zeros((2 * m, 2 * n)), np.eye(2 * m, k=m) / h]])[:, :])
    x, states = np.zeros(2 * n), []
    for now, then in zip(u, [*u[1:], u[-1]], strict=True):
        states.append(x)
        x = (step @ np.concatenate([x, now, then - now]))[: 2 * n]
    return np.array(states) @ np.hstack([system["C1"], system["C2"]]).T


BEAM = """\
name: spin-up
output: {output}
components:
  hub:
    rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}
    interfaces: {{axle: {{position: [0, 0, 0]}}, wall: {{position: [0, 0, 0]}}}}
  beam:
    stiffness: {{file: beam.op4, matrix: KAA}}
    mass: {{file: beam.op4, matrix: MAA}}
    geometry: beam.bdf
    interfaces: {{root: {{node: 1}}}}
scene:
  band: 50 Hz
  ground: hub.wall
  joints: {{axle: {{connect: [hub.axle, beam.root], free: [rz]}}}}
  actuators: {{motor: {{joint: axle}}}}
  sensors:
    angle: {{joint: axle}}
    tip: {{at: beam.9, measure: [x, y]}}
reduce: {{cutoff: 2}}
write: {{formats: [hdf5], frame: {{kind: clamped, at: root}}}}
"""


def test_spin_up_of_an_exported_beam(tmp_path: Path) -> None:
    """A pulse of torque through a large angle, against a plane beam in its own three modes, integrated by scipy."""
    length, elements = 2.0, 8
    body = line("beam", [0, 0, 0], [length, 0, 0], elements, interfaces={"root": 1})
    write_body(tmp_path, body)
    script = exported(finished(tmp_path, BEAM), tmp_path / "exudyn")

    def torque(t: float) -> float:
        return 50.0 * float(np.sin(np.pi * t / 2.0) ** 2)

    script.LAWS["motor"] = torque
    script.RADIUS = 1.0
    scene = script.build()
    end, step = 1.0, 1e-3
    times, seen, modes = scene.simulate(end, step)
    angle, across = seen[:, 0], modes["beam"]
    plane = np.isin(body.dofs.component, (2, 6))
    K, M = (A.toarray()[np.ix_(plane, plane)] for A in (body.K, body.M))
    model = PlaneBeam.of(K, M, np.linspace(0, length, elements + 1), count=3)
    expected = model.spun_up(torque, times)
    assert angle[-1] > 2.0
    with np.load(tmp_path / "exudyn" / "beam.npz", allow_pickle=True) as file:
        tip = file["modeBasis"].reshape(-1, 3, across.shape[1])[file["nodeIds"].tolist().index(elements + 1)]
    deflection = across @ tip[1]
    c, s = np.cos(angle), np.sin(angle)
    path = np.column_stack([length * c - deflection * s, length * s + deflection * c])
    for found, known in ((deflection, expected[:, 2]), (path, expected[:, :2])):
        assert np.sqrt(((found - known) ** 2).mean() / (known**2).mean()) < 1e-4


def test_the_script_runs_by_itself(robot: Path, tmp_path: Path) -> None:
    """Its slew, as a user starts it: tables with every sensor and mode, and a joint that turns."""
    folder = tmp_path / "exudyn"
    export_scene(multibody_scene(robot), "exudyn", folder)
    done = subprocess.run(
        [sys.executable, "scene.py"], cwd=folder, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stderr
    with (folder / "sensors.csv").open() as file:
        names = file.readline().strip().split(",")
    rows = np.loadtxt(folder / "sensors.csv", delimiter=",", skiprows=1)
    assert names[:3] == ["t", "station.y", "station.rz"] and rows.shape[1] == len(names)
    assert np.isfinite(rows).all() and abs(rows[:, names.index("turned")]).max() > 0.1
    assert np.loadtxt(folder / "modes.csv", delimiter=",", skiprows=1).shape[0] == rows.shape[0]


def test_a_folder_with_files_is_left_alone(robot: Path, tmp_path: Path) -> None:
    (tmp_path / "scene.py").write_text("mine")
    with pytest.raises(WriteError, match="holds files already"):
        export_scene(multibody_scene(robot), "exudyn", tmp_path)
    assert (tmp_path / "scene.py").read_text() == "mine"
