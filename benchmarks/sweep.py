"""A sweep of 200 points: on one core, on several, on a Dask cluster, and as separate runs that share nothing.

Methods x angles x cutoffs x orders of the Galileo sample; an order is the least share of the largest coefficient that
is kept. Each way starts in a new process from an empty folder, with as many threads of algebra as its cores give it,
and every point writes its component files in all of them. Separate runs are timed on a sample of points, evenly spread,
and scaled up; ``--separate 200`` times them all. ``--efficiency`` prints the table of processes alone: measured for 1,
2, 4, ... processes up to the cores of the machine, and beyond by Amdahl's law with the serial part and the start that 1
and 2 measure.
"""

from __future__ import annotations

import argparse
import csv
import itertools
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
PIPELINE = ROOT / "pipelines" / "galileo.yaml"
SET = ("verify.compare={}",)
OVER = {
    "reduce.method": ("craig-bampton", "macneal-rubin", "benfield-hruda", "augmented"),
    "scene.articulation.spin": ("0 deg", "90 deg"),
    "reduce.cutoff": ("2", "3", "4", "5", "6"),
    "balance.keep.fraction": ("0.1", "0.01", "1e-3", "1e-4", "1e-5"),
}
# Processes of a cluster whose times the model gives.
MODELLED = (8, 64, 256)
# Below this load on average another program is hardly felt.
_QUIET = 0.3


def seconds_of(*arguments: str, cores: int | None = None) -> NDArray[np.float64]:
    """Wall time and processor time of a command and its processes; a broken limit is a result, too."""
    kept = sorted(os.sched_getaffinity(0))[:cores]
    started = np.array([time.perf_counter(), processor_time()])
    done = subprocess.run(
        [sys.executable, "-m", "cmsreduce.cli", *arguments, "--quiet"],
        cwd=ROOT,
        capture_output=True,
        check=False,
        preexec_fn=lambda: os.sched_setaffinity(0, kept),
    )
    if done.returncode not in (0, 1):
        raise SystemExit(done.stderr.decode())
    return np.array([time.perf_counter(), processor_time()]) - started


def processor_time() -> float:
    """Seconds of processor time of all processes that this one has started and that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def swept(
    folder: Path, jobs: int, cores: int | None = None, cluster: Path | None = None, most: int | None = None
) -> NDArray[np.float64]:
    """Wall and processor time of the sweep for a number of processes, on all cores or on some, here or on a cluster."""
    over = [word for key, values in OVER.items() for word in ("--over", f"{key}={','.join(values[:most])}")]
    sets = [word for text in SET for word in ("--set", text)]
    where = ["--jobs", str(jobs)] if cluster is None else ["--cluster", str(cluster)]
    return seconds_of("sweep", str(PIPELINE), *sets, *over, *where, "--out", str(folder), cores=cores)


def efficiency(folder: Path, most: int | None) -> None:
    """Table of processes: seconds and efficiency, of processes of this machine and of a Dask cluster."""
    file = folder / "cluster.yaml"
    numbers = [n for n in (2, 4, 8, 16, 32, 64, 128, 256) if n <= (os.cpu_count() or 1)]
    one = swept(folder / "one", 1, 1, most=most)[0]
    print("| processes | --jobs, s | efficiency | Dask, s | efficiency |\n|---|---|---|---|---|")
    print(f"| 1 | {one:.1f} | | | |")
    columns = []
    for kind, cluster in (("jobs", None), ("dask", file)):
        measured = []
        for n in numbers:
            file.write_text(f"kind: local\nworkers: {n}\nthreads: 1\n")
            measured.append(swept(folder / f"{kind}-{n}", n, n, cluster, most)[0])
        # What one point takes beyond the same without processes is their start.
        file.write_text("kind: local\nworkers: 2\nthreads: 1\n")
        points = [swept(folder / f"{kind}{n}", n, n, where, most=1)[0] for n, where in ((1, None), (2, cluster))]
        start = max(points[1] - points[0], 0.0)
        # One process takes the serial part and the shared one; two take their start, the serial part, and half of it.
        shared = min(2 * (one - measured[0] + start), one)
        columns.append([*measured, *(start + one - shared + shared / n for n in MODELLED if n not in numbers)])
        print(f"{kind}: start {start:.1f} s, serial {one - shared:.1f} s", file=sys.stderr)
    rows = [*numbers, *(n for n in MODELLED if n not in numbers)]
    for n, *times in zip(rows, *columns, strict=True):
        cells = " | ".join(f"{time:.1f} | {100 * one / (n * time):.0f} %" for time in times)
        print(f"| {n}{'' if n in numbers else ', by the model'} | {cells} |")


def alone(folder: Path, values: tuple[str, ...], number: int) -> NDArray[np.float64]:
    """Wall and processor time of one point as a run of its own."""
    chosen = [*SET, *(f"{key}={value}" for key, value in zip(OVER, values, strict=True))]
    sets = [word for text in chosen for word in ("--set", text)]
    return seconds_of("run", str(PIPELINE), *sets, "--out", str(folder / str(number)))


def statuses(folder: Path) -> str:
    """Numbers of points that passed, broke a limit, failed."""
    with (folder / "sweep.csv").open(encoding="utf-8", newline="") as file:
        found = [row["status"] for row in csv.DictReader(file)]
    return ", ".join(f"{found.count(status)} {status}" for status in dict.fromkeys(found))


def said(times: NDArray[np.float64]) -> str:
    """Both times as text."""
    return f"{times[0]:.1f} s (processor {times[1]:.1f} s)"


def main() -> None:
    """Time the three ways, and print the load of the machine."""
    reader = argparse.ArgumentParser(description=__doc__)
    reader.add_argument("--separate", type=int, default=20, help="points timed as separate runs")
    reader.add_argument("--jobs", type=int, default=2)
    reader.add_argument("--efficiency", action="store_true", help="the table of processes alone")
    reader.add_argument("--values", type=int, help="with --efficiency: so many values of each key")
    asked = reader.parse_args()
    points = list(itertools.product(*OVER.values()))
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if asked.efficiency:
            efficiency(folder, asked.values)
            return
        one = swept(folder / "one", 1, 1)
        print(f"{len(points)} points on one core: {said(one)} ({statuses(folder / 'one')})", flush=True)
        threaded = swept(folder / "threaded", 1)
        print(f"in one process on all cores: {said(threaded)}, {one[0] / threaded[0]:.2f} times as fast", flush=True)
        several = swept(folder / "several", asked.jobs)
        print(f"in {asked.jobs} processes: {said(several)}, {one[0] / several[0]:.2f} times as fast", flush=True)
        print(f"with the cores to themselves: at most {asked.jobs * one[1] / several[1]:.2f}, by the processor times")
        print(f"once more, all finished: {said(swept(folder / 'one', 1))}", flush=True)
        sample = points[:: max(1, len(points) // asked.separate)]
        each = np.mean([alone(folder / "alone", values, k) for k, values in enumerate(sample)], axis=0)
    whole = each * len(points)
    print(f"separate runs: {said(each)} each ({len(sample)} timed), {said(whole)} for all")
    for what, found in (("one process on one core", one), (f"{asked.jobs} processes", several)):
        wall, processor = whole / found
        print(f"the sweep in {what} is {wall:.1f} times as fast, and takes {processor:.1f} times less processor time")
    other = "quiet" if load < _QUIET else f"not quiet: a load of {load:.1f} before the first run"
    print(f"{os.cpu_count()} cores, {other}")


if __name__ == "__main__":
    main()
