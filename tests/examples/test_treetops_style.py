"""The reference consumer: what must stay constant does, and small motions are those of the assembled system."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import h5py
import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from tests.pipeline.study import arm, panel, write_body

EXAMPLE = Path(__file__).parents[2] / "examples" / "treetops_style.py"

PIPELINE = """\
name: pair
output: out
components:
  arm:
    stiffness: {file: arm.op4, matrix: KAA}
    mass: {file: arm.op4, matrix: MAA}
    geometry: arm.bdf
    interfaces: {root: {node: 1}, tip: {node: 5}}
  panel:
    stiffness: {file: panel.op4, matrix: KAA}
    mass: {file: panel.op4, matrix: MAA}
    geometry: panel.bdf
    interfaces: {root: {node: 1}}
scene:
  band: 60 Hz
  joints: {hinge: {connect: [arm.tip, panel.root], free: [ry]}}
reduce: {method: craig-bampton, cutoff: 15}
write: {formats: [hdf5]}
"""


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Component files and system of an arm with a panel hinged to it, floating."""
    folder = tmp_path_factory.mktemp("pair")
    for body in (arm(), panel()):
        write_body(folder, body)
    path = folder / "pair.yaml"
    path.write_text(PIPELINE.replace("output: out", f"output: {folder / 'out'}"))
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Silent()), path)
    return folder / "out"


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("treetops_style", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Data classes look their module up by its name.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def pair(example: ModuleType, folder: Path, modes: int):
    bodies = [example.load(folder / f"{name}.h5").cut(modes) for name in ("arm", "panel")]
    return example.Tree(bodies, [example.Hinge("arm.tip", "panel.root", axis=1)])


def test_it_is_short_and_needs_little() -> None:
    lines = EXAMPLE.read_text().splitlines()
    assert len(lines) < 300
    foreign = {line.split()[1].split(".")[0] for line in lines if line.startswith(("import ", "from "))}
    assert foreign - set(sys.stdlib_module_names) == {"numpy", "h5py"}


def test_free_motion_keeps_energy_and_momentum(example: ModuleType, run_dir: Path) -> None:
    """Tumbling at half a radian a second or so with the panel swinging and both bodies vibrating."""
    tree = pair(example, run_dir, 2)
    start = tree.rest()
    start.u[:] = [0.1, -0.2, 0.3, 4.0, -5.0, 6.0, 8.0, 0.02, -0.01, 0.03, 0.02]
    s = start
    for number in range(80):
        s = tree.step(s, number * 1e-3, 1e-3, lambda *_: np.zeros(1))
    energy, momentum = tree.energy(start), tree.momentum(start)
    assert abs(s.angles[0]) > 0.5
    assert abs(tree.energy(s) / energy - 1) < 1e-8
    assert abs(tree.momentum(s) - momentum).max() < 1e-8 * abs(momentum).max()


def test_a_slew_conserves_what_it_should(example: ModuleType, run_dir: Path) -> None:
    """The motor is inside: momentum stays zero, and energy is the motor's work; axes of bodies stay orthonormal."""
    tree = pair(example, run_dir, 2)
    states = example.slew(tree, np.pi / 2, 0.1, 100)
    most = max(tree.energy(s) for s in states)
    momentum = max(abs(tree.momentum(s)).max() for s in states)
    assert 1.0 < states[-1].angles[0] < 2.0
    assert max(abs(tree.energy(s) - s.work) for s in states) < 1e-8 * most
    assert momentum < 1e-8 * np.sqrt(most * sum(body.mass for body in tree.bodies))
    R = states[-1].axes
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (2, 1, 1)), atol=1e-9)


def test_small_motions_have_the_frequencies_of_the_assembled_system(example: ModuleType, run_dir: Path) -> None:
    bodies = [example.load(run_dir / f"{name}.h5") for name in ("arm", "panel")]
    tree = example.Tree(bodies, [example.Hinge("arm.tip", "panel.root", axis=1)])
    rest = tree.rest()
    # Accelerations of the speeds, for each modal coordinate of 1.
    pulled = []
    for q in np.eye(rest.q.size):
        pulled.append(
            -tree.rate(example.State(rest.place, rest.axes, rest.angles, 1e-9 * q, rest.u), np.zeros(1)).u[7:]
        )
    squared = np.sort(np.linalg.eigvals(np.array(pulled).T / 1e-9).real)
    with h5py.File(run_dir / "system.h5") as file:
        hertz = file["configuration_0/frequency_hz"][()]
    np.testing.assert_allclose(np.sqrt(squared) / (2 * np.pi), hertz[7:], rtol=1e-8)


def test_it_runs_from_the_command_line(run_dir: Path) -> None:
    files = [str(run_dir / f"{name}.h5") for name in ("arm", "panel")]
    # So small a turn that the bodies hardly bend in so short a time.
    slew = ["--turn", "1e-4", "--duration", "1e-4", "--steps", "2"]
    options = ["--hinge", "arm.tip", "panel.root", "--axis", "1", *slew]
    done = subprocess.run([sys.executable, str(EXAMPLE), *files, *options], capture_output=True, text=True, check=True)
    assert done.stdout.count("deg") == 3
