"""A scene of many large bodies: a chain of solid bars, each of its own length, reduced in one process and in two.

``python benchmarks/many_bodies.py [BODIES] [DOFS]`` prints seconds of one process on one core, of one on all cores by
the threads of its algebra, and of ``run --jobs 2``, with what the last one gains; 16 bodies of 1e4 dofs if no numbers
are given.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.files_to_verdict import SIDES, cells_for, write_bar  # noqa: E402

SCENE = """\
scene:
  band: 200 Hz
  ground: b0.root
  joints:
{joints}
  actuators: {{motor: {{joint: j1, dof: rz}}}}
  sensors: {{tip: {{at: {last}.tip, measure: [x, y, z]}}}}
reduce: {{cutoff: 2}}
verify: {{frf: {{points: 100}}, limits: {{frf_error: 50 %}}}}
write: {{formats: [hdf5]}}
"""


def write_chain(folder: Path, bodies: int, dofs: float) -> Path:
    """Files and pipeline of the chain; no two bars have as many cells along their length."""
    along, *across = cells_for(dofs)
    parts, joints = [], []
    for k in range(bodies):
        parts.append(write_bar(folder, f"b{k}", (along + k, *across), k * SIDES[0]))
        if k:
            joints.append(f"    j{k}: {{connect: [b{k - 1}.tip, b{k}.root], free: [rz]}}\n")
    path = folder / "chain.yaml"
    scene = SCENE.format(joints="".join(joints).rstrip(), last=f"b{bodies - 1}")
    path.write_text("name: chain\ncomponents:\n" + "".join(parts) + scene)
    return path


def main() -> None:
    """Print the table."""
    bodies, dofs = (float(each) for each in (sys.argv[1:] or ("16", "1e4")))
    with tempfile.TemporaryDirectory() as name:
        path = write_chain(Path(name), int(bodies), dofs)
        every, seconds = sorted(os.sched_getaffinity(0)), []
        for jobs, cores in ((1, every[:1]), (1, every), (2, every)):
            out = Path(name, str(len(seconds)))
            command = [sys.executable, "-m", "cmsreduce.cli", "run", str(path), "--jobs", str(jobs), "--quiet"]
            started = time.perf_counter()
            done = subprocess.run(
                [*command, "--out", str(out)], cwd=ROOT, check=False, preexec_fn=partial(os.sched_setaffinity, 0, cores)
            )
            assert done.returncode in (0, 1), done
            seconds.append(time.perf_counter() - started)
    one, threaded, two = seconds
    print("| bodies of about so many dofs | one core, s | all cores, s | two processes, s | gain over one core, all |")
    print("|---|---|---|---|---|")
    times = " | ".join(f"{time:.1f}" for time in seconds)
    print(f"| {bodies:g} of {dofs:,.0f} | {times} | {one / two:.2f}, {threaded / two:.2f} |")


if __name__ == "__main__":
    main()
