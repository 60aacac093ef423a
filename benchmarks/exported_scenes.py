"""Galileo's pair as `cmsreduce export` writes it, run unedited in other programs: a table of benchmarks/consumers.md.

Exudyn is in the extra ``exudyn``; others are found by an environment variable. Rows of programs that are not here stay
as they were.
"""

from __future__ import annotations

import importlib.util
import math
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
# The predictions live with the tests, and the elements with the script of the sample; neither is installed.
sys.path[:0] = [str(ROOT), str(ROOT / "sample_models" / "galileo")]

import make  # noqa: E402
from consumer_tests import print_part, printed  # noqa: E402

from cmsreduce import __version__, simulate  # noqa: E402
from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.pipeline import Run, Silent, execute  # noqa: E402
from cmsreduce.pipeline.results import multibody_scene  # noqa: E402
from cmsreduce.write import export_scene  # noqa: E402
from tests.consumers.galileo import PIPELINE, SAMPLE  # noqa: E402
from tests.consumers.predictions import HingedPair, Particles  # noqa: E402
from tests.consumers.scene_42 import PROGRAM as PROGRAM_42  # noqa: E402
from tests.consumers.scene_42 import simulated as run_42  # noqa: E402

NAME = "exported scenes"
KEPT, FEW = "{rotor: 19, stator: 10}", "{rotor: 8, stator: 4}"
WRITE = "write: {formats: [hdf5], frame: {kind: clamped, at: spin_bearing}}\n"
# Seconds between the values that are compared.
INTERVAL = 0.05


@dataclass(frozen=True)
class Case:
    """A motion of the pair from rest: a torque of the motor over time.

    Parameters
    ----------
    torque : float
        Largest torque in N m, of a pulse sin^2.
    pulse, seconds, step : float
        Length of the pulse, of the motion and of a time step in s.
    """

    torque: float
    pulse: float
    seconds: float
    step: float = 1e-3

    @property
    def every(self) -> int:
        """Steps between two values that are compared."""
        return round(INTERVAL / self.step)

    @property
    def times(self) -> np.ndarray:
        """Times of the values that are compared."""
        return np.arange(round(self.seconds / INTERVAL) + 1) * INTERVAL

    def law(self, t: float) -> float:
        """Torque at a time."""
        return self.torque * math.sin(math.pi * t / self.pulse) ** 2 if t < self.pulse else 0.0


CASES = {
    "small motion": Case(0.04, 1.0, 3.0),
    "free vibration": Case(40.0, 1.0, 10.0, step=2.5e-4),
    "torque pulse": Case(40.0, 4.0, 6.0),
    "spin-up": Case(40.0, 12.0, 13.0),
}


@dataclass(frozen=True, eq=False)
class Motion:
    """Result of a program for a case.

    Parameters
    ----------
    version : str
        Version of the program.
    modes : mapping of body to (times, k) float64
        Modal coordinates at the times of the case, those of the component file.
    """

    version: str
    modes: Mapping[str, np.ndarray]


def exudyn(run: Path, folder: Path, case: Case) -> Motion | None:
    """The exported script as it is, but for the law of the motor."""
    if importlib.util.find_spec("exudyn") is None:
        return None
    export_scene(multibody_scene(run), "exudyn", folder)
    spec = importlib.util.spec_from_file_location(folder.name, folder / "scene.py")
    assert spec is not None and spec.loader is not None
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.LAWS["motor"] = case.law
    _, _, modes = script.build().simulate(case.seconds, case.step)
    return Motion(script.exu.__version__, {name: each[:: case.every] for name, each in modes.items()})


def mbdyn(run: Path, folder: Path, case: Case) -> Motion | None:
    """The exported input as it is, but for the law of the motor, the end and the step."""
    program = os.environ.get("CMSREDUCE_MBDYN")
    if program is None:
        return None
    scene = multibody_scene(run)
    main, *_ = export_scene(scene, "mbdyn", folder)
    law = f"cosine, 0., {2 * math.pi / case.pulse!r}, {case.torque / 2!r}, one, 0."
    text = re.sub('(name, "motor", )[^;]*;', rf"\g<1>{law};", main.read_text(), count=1)
    for name, value in (("SECONDS", case.seconds), ("STEP", case.step)):
        text = re.sub(rf"real {name} = .*?;", f"real {name} = {value!r};", text)
    main.write_text(text)
    done = subprocess.run([program, "-f", main.name], cwd=folder, capture_output=True, text=True, check=True)
    rows = [row.split()[:2] for row in main.with_suffix(".mod").read_text().splitlines()]
    labels = list(dict.fromkeys(label for label, _ in rows))
    modes = np.array([float(value) for _, value in rows]).reshape(-1, len(labels))[:: case.every][: case.times.size]
    number = {name: re.search(rf"integer body_{name} = (\d+);", text)[1] for name in ("rotor", "stator")}  # type: ignore[index]
    version = re.search(r"MultiBody Dynamics (\S+)", done.stdout)
    return Motion(
        version[1] if version else "of unknown version",
        {name: modes[:, [label.split(".")[0] == key for label in labels]] for name, key in number.items()},
    )


def nasa_42(run: Path, folder: Path, case: Case) -> Motion | None:
    """The exported folder as it is, but for the law of the motor, the end and the step."""
    if not PROGRAM_42:
        return None
    scene = multibody_scene(run)
    export_scene(scene, "42", folder)
    _, modes = run_42(folder, {"motor": case.law}, case.seconds, case.step)
    modes = modes[:: case.every]
    counts = {
        name: int(count) for name, count in re.findall(r"^(\w+): (\d+) modes$", (folder / "scene.py").read_text(), re.M)
    }
    ends = np.cumsum([0, *counts.values()])
    source = Path(PROGRAM_42).resolve().parent
    commit = subprocess.run(
        ["git", "-C", source, "rev-parse", "--short=7", "HEAD"], capture_output=True, text=True, check=False
    )
    parts = zip(counts, ends[:-1], ends[1:], strict=True)
    return Motion(commit.stdout.strip() or "of unknown version", {name: modes[:, a:b] for name, a, b in parts})


def ours(run: Path, folder: Path, case: Case) -> Motion:
    """Our own integrator on the files of the run."""
    motion = simulate(run, case.seconds, efforts={"motor": case.law}, points=case.times.size - 1)
    return Motion(__version__, motion.modal)


OURS = "cms.simulate"
PROGRAMS: dict[str, Callable[[Path, Path, Case], Motion | None]] = {
    OURS: ours,
    "Exudyn": exudyn,
    "MBDyn": mbdyn,
    "42": nasa_42,
}
"""Programs by name, our own first; each returns None where it is not installed."""


def main() -> None:
    """Run every case in every program, and write the table."""
    with tempfile.TemporaryDirectory() as temporary:
        lines = table(Path(temporary), printed(NAME))
    print_part(NAME, lines)
    print("\n".join(lines))


def table(folder: Path, last: list[str]) -> list[str]:
    """Rows of the table, and the versions below it; those of programs that are not here from the last one."""
    run = finished(folder)
    before = [version for line in last if line.startswith("Versions: ") for version in line[10:-1].split(", ")]
    pair = HingedPair(
        Particles.of(run.final["stator"], "spin_bearing", make.stator()),
        Particles.of(run.final["rotor"], "spin_bearing", make.rotor()),
    )
    rows, versions = [], [f"cmsreduce {__version__}", f"Python {platform.python_version()}"]
    for name, case in CASES.items():
        angle, expected = pair.turned_by(case.law, case.times)
        split = run.final["stator"].omega.size - run.final["stator"].rigid_count
        particles = {"stator": expected[:, :split], "rotor": expected[:, split:]}
        for program, simulated in PROGRAMS.items():
            start = time.perf_counter()
            motion = simulated(run.folder, folder / f"{program} {name}", case)
            if motion is None:
                rows += [row for row in last if row.startswith(f"| {name} |") and f"| {program} |" in row]
                versions += [version for version in before if version.startswith(f"{program} ")]
                continue
            seconds = time.perf_counter() - start
            if program == OURS:
                reference = motion.modes
            versions += [f"{program} {motion.version}"] if program != OURS else []
            errors = [
                f"{rms(motion.modes[body], known[body]):.1e}" if known is particles or program != OURS else ""
                for known in (reference, particles)
                for body in ("rotor", "stator")
            ]
            rows.append(
                f"| {name} | {np.rad2deg(angle[-1]):.0f} deg | {program} | {' | '.join(errors)} | {seconds:.0f} |"
            )
    head = [
        f"| case | turned by | program | against {OURS}: rotor | stator | against particles: rotor | stator | s |",
        "|---|---|---|---|---|---|---|---|",
    ]
    return [*head, *rows, "", f"Versions: {', '.join(dict.fromkeys(versions))}."]


def finished(folder: Path) -> Run:
    """Run of the pair, whose files are written."""
    path = folder / "pair.yaml"
    path.write_text(PIPELINE.format(sample=SAMPLE).replace(KEPT, FEW) + WRITE)
    run = Run(load_pipeline(path), folder / "run", Silent())
    execute(run, path, report=False)
    return run


def rms(found: np.ndarray, known: np.ndarray) -> float:
    """Difference of all modal coordinates over time, relative to the coordinates."""
    return float(np.linalg.norm(found - known) / np.linalg.norm(known))


if __name__ == "__main__":
    main()
