"""Scenes that `cmsreduce export` wrote run in Exudyn unedited: small motions as assembled, large ones as predicted."""

from __future__ import annotations

import importlib.util
import re
import subprocess
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.model import MultibodyScene
from cmsreduce.pipeline.results import multibody_scene
from cmsreduce.simulate import Pulse, simulate_scene
from cmsreduce.write import export_scene
from tests.consumers.exported import BALL, BEAM, GIMBAL, assembled, finished, linear, pulse
from tests.consumers.predictions import PlaneBeam
from tests.frames import line
from tests.pipeline.study import arm, write_body

pytest.importorskip("exudyn")

pytestmark = pytest.mark.exudyn

NAMES = count()


def exported(run: Path, folder: Path, configuration: str | None = None) -> ModuleType:
    """The script that was exported, as a module."""
    export_scene(multibody_scene(run, configuration), "exudyn", folder)
    spec = importlib.util.spec_from_file_location(f"exported_{next(NAMES)}", folder / "scene.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def beside_simulate(
    script: ModuleType, scene: MultibodyScene, one: Pulse, two: Pulse, step: float
) -> tuple[np.ndarray, dict[str, float]]:
    """Sensors of rigid bodies through 0.3 s under two pulses, (times, sensors), and how far `cms.simulate` is away."""
    script.LAWS["one"], script.LAWS["two"] = one, two
    script.RADIUS = 1.0
    built = script.build()
    times, seen, modes = built.simulate(0.3, step)
    assert not modes
    efforts = {"one": one, "two": two}
    motion = simulate_scene(scene, {}, 0.3, points=times.size - 1, efforts=efforts, accuracy=1e-7)
    # Exudyn's sensors measure from the start.
    known = {name: motion.sensors[name] - motion.sensors[name][0] for name in built.channels}
    errors = [
        ((found - known[name]) ** 2).mean() / (known[name] ** 2).mean()
        for name, found in zip(known, seen.T, strict=True)
    ]
    return seen, dict(zip(known, np.sqrt(errors), strict=True))


@pytest.mark.parametrize("number", [0, 1])
def test_small_motions_are_those_of_the_assembled_system(robot: Path, tmp_path: Path, number: int) -> None:
    """Frequencies of the script's own linearisation, and every sensor's answer to every actuator."""
    name, system = assembled(robot, number)
    small_motions(exported(robot, tmp_path / "exudyn", name), system)


@pytest.mark.parametrize(
    ("ends", "earlier", "later"),
    [
        ("arm.root, mount.h", "rx", "ry"),
        ("arm.root, mount.h", "rx", "rz"),
        ("mount.h, arm.root", "ry", "rz"),
    ],
)
def test_small_motions_of_turned_universal_joints_and_balls(
    tmp_path: Path, ends: str, earlier: str, later: str
) -> None:
    """The axes of springs, motors and sensors are those of the assembled system; an arm swings with its node."""
    write_body(tmp_path, arm())
    text = GIMBAL.replace("ENDS", ends).replace("EARLIER", earlier).replace("LATER", later)
    run = finished(tmp_path, text)
    name, system = assembled(run, 0)
    small_motions(exported(run, tmp_path / "exudyn", name), system, 2.5e-4)


def small_motions(script: ModuleType, system: dict[str, Any], step: float = 5e-4) -> None:
    for k, actuator in enumerate(script.LAWS):
        script.LAWS[actuator] = pulse(1e-4 * (1 + k), 0.15 / (1 + k % 3))
    scene = script.build()
    scene.mbs.Assemble()
    found = np.sqrt(np.sort(scene.mbs.ComputeODE2Eigenvalues(useAbsoluteValues=True)[0])) / (2 * np.pi)
    expected = system["frequency_hz"]
    # Exudyn differentiates springs numerically.
    np.testing.assert_allclose(found[-expected.size :], expected, rtol=1e-6)
    times, seen, _ = scene.simulate(0.2, step, 1e-11)
    answer = linear(system, [script.LAWS[name] for name in script.LAWS], times)
    assert [*scene.channels] == [name.decode() for name in system["outputs"]]
    apart = np.sqrt(((seen - answer) ** 2).mean(axis=0) / (answer**2).mean(axis=0))
    # The rest falls with the square of the step, from 2e-2 at 1 ms.
    assert apart.max() < 1e-2, dict(zip(scene.channels, apart, strict=True))


def test_large_motions_of_a_universal_joint_between_rigid_bodies(tmp_path: Path) -> None:
    """Against `cms.simulate`: its springs and motors act on angles about axes of two bodies, through 0.5 rad."""
    text = GIMBAL.replace("ENDS", "mount.h, arm.root").replace("EARLIER", "rx").replace("LATER", "ry")
    rigid = "    rigid: {{mass: 2, cg: [0.4, 0, 0], inertia: [0.02, 0.1, 0.1, 0, 0, 0]}}\n    interfaces: {{"
    rigid += "root: {{position: [0, 0, 0]}}, tip: {{position: [0.8, 0, 0]}}}}\n"
    text = re.sub(r"    stiffness: \{\{file.*?(?=    place)", rigid, text, count=1, flags=re.S)
    text = re.sub(
        "    ball:.*?(?=  articulation)",
        "    weld: {{connect: [arm.tip, pod.socket], offset: [0.1, -0.1, 0.05]}}\n",
        text,
        flags=re.S,
    )
    text = re.sub(", ball.rx.*deg|    third.*\n|    three.*\n", "", text)
    run = finished(tmp_path, text)
    script = exported(run, tmp_path / "exudyn")
    seen, apart = beside_simulate(script, multibody_scene(run), Pulse(60.0, 0.2), Pulse(-80.0, 0.1), 1e-3)
    assert max(apart.values()) < 1e-3, apart
    assert abs(seen[:, :2]).max(axis=0).min() > 0.2


def test_springs_of_a_ball_through_a_large_angle(tmp_path: Path) -> None:
    """Against `cms.simulate`, whose springs keep the energy: unlike springs, two motors, through one radian."""
    run = finished(tmp_path, BALL)
    script = exported(run, tmp_path / "exudyn")
    seen, apart = beside_simulate(script, multibody_scene(run), Pulse(12.0, 0.3), Pulse(-8.0, 0.2), 2e-3)
    assert abs(seen[:, 0]).max() > 1.0
    assert max(apart.values()) < 1.5e-3, apart


def test_spin_up_of_an_exported_beam(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
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
        error = np.sqrt(((found - known) ** 2).mean() / (known**2).mean())
        record_property("error", float(error))
        assert error < 1e-4


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


@pytest.mark.parametrize(("program", "says"), [("mbsim", "convert BODY.h5 OUT --for mbsim"), ("exodyn", "'exudyn'")])
def test_a_program_that_takes_no_scene_is_refused(robot: Path, tmp_path: Path, program: str, says: str) -> None:
    with pytest.raises(WriteError, match=says):
        export_scene(multibody_scene(robot), program, tmp_path / "scene")
    assert not (tmp_path / "scene").exists()
