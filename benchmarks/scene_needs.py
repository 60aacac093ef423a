"""Cost of a channel: Galileo with a channel more and a channel less, side by side.

A thruster and an accelerometer stand at the end of the rotor boom, beside the motor and the gyro of the pipeline file.
Each line is one run into an empty folder: `cutoff: auto`, the fewest modes below an frf_error of 0.05, component files.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.pipeline import Run, Silent, execute  # noqa: E402

GALILEO = ROOT / "pipelines" / "galileo.yaml"
ASKED = (
    "reduce={method: craig-bampton, cutoff: auto}",
    "balance.keep={frf_error: 0.05}",
    "scene.articulation={spin: [0, 45 deg], cone: [30 deg]}",
    "verify=null",
)
BOOM = 1312
THRUSTER = f"scene.actuators.thruster={{at: rotor.{BOOM}, force: [0, 0, 1]}}"
TIP = f"scene.sensors.tip={{at: rotor.{BOOM}, measure: [z]}}"
SCENES = {
    "motor, thruster; gyro, accelerometer": (THRUSTER, TIP),
    "without the accelerometer": (THRUSTER,),
    "without the thruster": (TIP,),
    "motor; gyro": (),
    "motor; rz of the gyro alone": ("scene.sensors.gyro={at: platform.cg, measure: [rz]}",),
}


def line(settings: tuple[str, ...]) -> list[str]:
    """Figures of one run."""
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        run = Run(load_pipeline(GALILEO, [*ASKED, *settings]), Path(folder), Silent())
        execute(run, GALILEO)
        seconds = time.perf_counter() - started
        names = run.reduced_names
        computed = [run.modal(name).elastic_count for name in names]
        kept = [run.kept[name].elastic_count for name in names]
        static = sum(run.reduced(name).modes.kind.count("constraint") for name in names)
        factors = sum(len(each) for name in names for each in run.stages.factorised[name].values())
        written = sum(path.stat().st_size for path in Path(folder).glob("*.h5")) / 1024
    return [
        " + ".join(f"{count}" for count in computed),
        str(static),
        " + ".join(f"{count}" for count in kept),
        str(factors),
        f"{written:.0f}",
        f"{seconds:.1f}",
    ]


def main() -> None:
    """Print the table."""
    # A first run loads libraries that every one of them needs.
    line(())
    head = ["scene", "modes computed", "constraint modes", "modes kept", "factorisations", "files, KiB", "seconds"]
    rows = [head, ["---"] * len(head), *([name, *line(settings)] for name, settings in SCENES.items())]
    width = np.array([[len(cell) for cell in row] for row in rows]).max(axis=0)
    for row in rows:
        print("| " + " | ".join(cell.ljust(int(size)) for cell, size in zip(row, width, strict=True)) + " |")


if __name__ == "__main__":
    main()
