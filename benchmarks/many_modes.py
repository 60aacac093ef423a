"""Hundreds of modes of one body: seconds, processor time and memory of cmsreduce and its peers.

``python benchmarks/many_modes.py bar-3e4 300 1000`` compares; ``--peers`` picks, ``--limit`` stops a peer.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
from math import log
from pathlib import Path

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "benchmarks" / "peers"))

from benchmarks import contest  # noqa: E402
from benchmarks.meshes import BODIES  # noqa: E402
from benchmarks.peers.problem import Problem  # noqa: E402
from cmsreduce.linalg.eigen import count_below  # noqa: E402
from cmsreduce.linalg.machine import SolverSettings, solver_settings  # noqa: E402

PEERS = ("cmsreduce", "arpack-multifrontal", "slepc-slices")
# The cutoff is found by counts until it has the modes asked for, or a few less. Their number grows as a power of it.
_FEWER = 0.01
_POWER = 1.5
_COUNTS = 20


def main(arguments: list[str]) -> None:
    """Run each peer for each number of modes and print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("body", choices=tuple(BODIES))
    parser.add_argument("modes", type=int, nargs="+")
    parser.add_argument("--peers", nargs="+", choices=tuple(contest.PEERS), default=PEERS, metavar="PEER")
    parser.add_argument("--limit", type=float, default=600.0, metavar="SECONDS")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)))
    given = parser.parse_args(arguments)
    print("| body, dofs | modes | peer | all, s | processor time, s | peak, GiB | residual |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        contest.make(given.body, folder)
        problem = Problem.load(folder)
        for modes in given.modes:
            hz, count = cutoff(problem, modes)
            numbers = {"name": given.body, "count": count, "cutoff_hz": hz}
            (folder / "problem.json").write_text(json.dumps(numbers), encoding="utf-8")
            for peer in given.peers:
                print(row(peer, given, problem.K.shape[0], count, folder), flush=True)


def cutoff(problem: Problem, modes: int) -> tuple[float, int]:
    """Frequency in Hz with about so many modes below it, and their number."""
    K, M = sp.csc_array(problem.K), sp.csc_array(problem.M)
    hz, count, power = problem.cutoff_hz, problem.count, _POWER
    with solver_settings(SolverSettings()):
        for _ in range(_COUNTS):
            last, before = hz, count
            hz *= ((1 - _FEWER / 2) * modes / count) ** (1 / power)
            count = count_below(K, M, 2 * np.pi * hz) or before
            if (1 - _FEWER) * modes <= count <= modes:
                break
            power = log(count / before) / log(hz / last) or power
    return hz, count


def row(peer: str, given: argparse.Namespace, n: int, modes: int, folder: Path) -> str:
    """One run of a peer as a row of the table."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    record = contest.compete(peer, given.body, n, folder, given.threads, given.limit)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    start = f"| {given.body}, {n} | {modes} | {contest.PEERS[peer].title} |"
    if record["status"] != "ok":
        return f"{start} {record['status']} | {spent:.0f} | | |"
    found = record["seconds"].get("certificate", 0.0) + record["total_s"]
    wrong = "" if len(record["hz"]) == modes else f", {len(record['hz'])} modes"
    return f"{start} {found:.1f} | {spent:.0f} | {record['peak_gib']:.2f} | {record['residual']:.0e}{wrong} |"


if __name__ == "__main__":
    main(sys.argv[1:])
