"""A whole `cmsreduce run` of a body of 3 060 dofs: seconds beyond the start of Python, and the error it reports.

Prints a Markdown table. The bar is held at its root by a few nodes or by all of the face, damped mode by mode or by a
loss factor, and verified or not; each run is the fastest of three.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.pipeline.study import write_body  # noqa: E402
from tests.solids import block  # noqa: E402

CELLS, SIDES = (33, 4, 5), (2.7, 0.2, 0.2)
FACES = {"4 nodes": (1, 2, 3, 7), "the face, 30 nodes": tuple(range(1, 31))}
LAWS = {"modal": "modal: 0.01", "structural": "structural: 0.02"}
VERIFY = {False: "", True: "verify: {frf: {points: 200}}\n"}
RUNS = 3
PIPELINE = """\
name: bar
output: {folder}/out
components:
  bar:
    stiffness: {{file: bar.op4, matrix: KAA}}
    mass: {{file: bar.op4, matrix: MAA}}
    geometry: bar.bdf
    interfaces: {{root: {{nodes: {nodes}}}}}
    damping: {{{law}}}
scene:
  band: 1.5 kHz
  ground: bar.root
  actuators: {{push: {{at: bar.1020, force: [0, 1, 0]}}}}
  sensors: {{tip: {{at: bar.1000, measure: [y, z]}}}}
reduce: {{cutoff: 3}}
{verify}"""


def seconds(command: Sequence[str], fresh: Path | None = None) -> float:
    """Wall time of a command, the least of a few; a folder of earlier results is taken away before each."""
    taken = []
    for _ in range(RUNS):
        if fresh is not None:
            shutil.rmtree(fresh, ignore_errors=True)
        started = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True)
        taken.append(time.perf_counter() - started)
    return min(taken)


def row(folder: Path, face: str, law: str, verified: bool, start: float) -> str:
    """Run one pipeline."""
    path = folder / "bar.yaml"
    nodes, verify = list(FACES[face]), VERIFY[verified]
    path.write_text(PIPELINE.format(folder=folder, nodes=nodes, law=LAWS[law], verify=verify))
    taken = seconds([sys.executable, "-m", "cmsreduce.cli", "run", str(path)], folder / "out") - start
    summary = json.loads((folder / "out" / "summary.json").read_text())
    error = f"{100 * summary['worst']['frf_error']:.2g} %" if verified else "not verified"
    return f"| {face} | {law} | {taken:.2f} | {error} |"


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_body(folder, block("bar", list(SIDES), list(CELLS)))
        start = seconds([sys.executable, "-c", "pass"])
        print("| held at | damping | run, s | worst response error |\n|---|---|---|---|")
        for verified in (False, True):
            for face in FACES:
                for law in LAWS if verified else ("modal",):
                    print(row(folder, face, law, verified, start), flush=True)


if __name__ == "__main__":
    main()
