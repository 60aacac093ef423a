"""The multifrontal solver beside PARDISO and SuperLU on slender solids: seconds and digits.

``python benchmarks/multifrontal.py [BODY ...] [--threads N]`` takes some of ``meshes.BODIES``; by default those of
10 000 and 30 000 dofs, half a minute in all. Each solver has the stiffness of the body with its ends held, analyses
and factorises it, and solves for one, eight and 64 columns; the least of three of each counts. ``error`` is the largest
residual of a row over the sum of the sizes of its terms.

``--counts`` counts the modes below the cutoff of each body instead: the negative pivots of K - omega^2 M.
``--ranks 1 2`` compares a factor in memory and one in a file with MUMPS on one and on two processes.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import problem  # noqa: E402
from cmsreduce.linalg.machine import (  # noqa: E402
    SolverSettings,
    mkl_library,
    solver_settings,
)
from cmsreduce.linalg.sparse import Factor, factorise, share_order  # noqa: E402
from cmsreduce.linalg.sparse.lower_triangle import nonzero_pattern  # noqa: E402
from cmsreduce.linalg.sparse.multifrontal import Multifrontal  # noqa: E402
from cmsreduce.linalg.sparse.mumps import Mumps  # noqa: E402
from cmsreduce.linalg.sparse.pardiso import Pardiso  # noqa: E402
from cmsreduce.multifrontal import CholeskyFactor, compile_loops, nested_dissection  # noqa: E402

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]

BODIES = ("bar-1e4", "bar-3e4")
WIDTHS = (1, 8, 64)
ROUNDS = 3
# SuperLU takes a minute for larger bodies.
SUPERLU_ROWS = 50_000
# Bytes a row: less than a factor of 1e5 rows takes, and more than the updates beside it.
_UPDATES = 4000.0


def multifrontal(K: sp.csc_array, threads: int) -> Solve:
    """Factor in double precision."""
    return CholeskyFactor(K, threads=threads).solve


def single(K: sp.csc_array, threads: int) -> Solve:
    """Factor in single precision, without refinement."""
    scale = 2.0 ** -np.round(np.log2(K.diagonal()) / 2)
    return CholeskyFactor(K, scale=scale, threads=threads).solve


def pardiso(K: sp.csc_array, threads: int) -> Solve:
    """Factor by MKL."""
    with solver_settings(SolverSettings("pardiso", threads=threads)):
        return Pardiso(K, True, lambda cost: None)._solve


def superlu(K: sp.csc_array, threads: int) -> Solve:
    """Factor by scipy on one thread, in the order of nested dissection."""
    order = nested_dissection(K)
    options = {"SymmetricMode": True}
    lu = spla.splu(K[order][:, order], permc_spec="NATURAL", diag_pivot_thresh=0.0, options=options)

    def solve(b: Array) -> Array:
        x = np.empty_like(b)
        x[order] = lu.solve(b[order])
        return x

    return solve


def rows(names: list[str], threads: int) -> Iterator[list[str]]:
    """A line of the table for each body and solver."""
    solvers = [multifrontal, single, *([pardiso] if mkl_library() is not None else []), superlu]
    # Compiled before a clock starts.
    for each in (multifrontal, single):
        each(sp.csc_array(sp.eye_array(8)), threads)(np.ones((8, 2)))
    for name in names:
        K = sp.csc_array(problem(name)[0].K)
        b = np.random.default_rng(0).standard_normal((K.shape[0], max(WIDTHS)))
        for solver in solvers:
            if solver is superlu and K.shape[0] > SUPERLU_ROWS:
                continue
            with solver_settings(SolverSettings(threads=threads)):
                factorise, solve = least(lambda solver=solver, K=K: solver(K, threads))
                given = [np.asfortranarray(b[:, :k]) for k in WIDTHS]
                solves = [least(lambda solve=solve, part=part: solve(part)) for part in given]
            x = solves[-1][1]
            error = float((abs(K @ x - b) / (abs(K) @ abs(x) + abs(b))).max())
            seconds = [f"{each:.3f}" for each in (factorise, *(found[0] for found in solves))]
            yield [name, str(K.shape[0]), solver.__name__, *seconds, f"{error:.0e}"]


def counts(names: list[str], threads: int) -> Iterator[list[str]]:
    """A line of the table for each body and way to count; the fill-reducing order is known, as in a run."""
    kinds = {
        "multifrontal, nothing kept": lambda A: Multifrontal(A, lambda cost: None, definite=False, solves=False),
        "multifrontal": lambda A: Multifrontal(A, lambda cost: None, definite=False),
        "PARDISO": lambda A: Pardiso(A, False, lambda cost: None),
    }
    if mkl_library() is None:
        del kinds["PARDISO"]
    compile_loops()
    for name in names:
        body = problem(name)[0]
        A = sp.csc_array(body.K - (2 * np.pi * body.cutoff_hz) ** 2 * body.M)
        for kind, make in kinds.items():
            with solver_settings(SolverSettings(threads=threads)) as settings:
                order = share_order(A)
                settings.orders.store(*nonzero_pattern(A), nested_dissection(A) if order is None else order)
                busy = time.process_time()
                seconds, factor = least(lambda make=make, A=A: make(A))
                busy = (time.process_time() - busy) / ROUNDS
            found = [f"{seconds:.2f}", f"{busy:.2f}", f"{factor.cost.bytes / 2**20:.0f}", str(factor.negative_pivots)]
            yield [name, str(A.shape[0]), kind, *found]
            del factor


def processes(names: list[str], ranks: list[int]) -> Iterator[list[str]]:
    """A line of the table for each body and number of processes; without any, the multifrontal factor in a file."""
    compile_loops()
    with tempfile.TemporaryDirectory() as scratch:
        kinds = {
            "multifrontal": SolverSettings("multifrontal"),
            "multifrontal, less memory": SolverSettings("multifrontal", scratch=Path(scratch)),
            **{f"MUMPS, {each} processes": SolverSettings("mumps", ranks=each) for each in ranks},
        }
        for name in names:
            K = sp.csc_array(problem(name)[0].K)
            b = np.random.default_rng(0).standard_normal((K.shape[0], 8))
            for kind, settings in kinds.items():
                memory = None if settings.scratch is None else _UPDATES * K.shape[0]
                with solver_settings(replace(settings, memory=memory, threads=max(ranks), precision="double")):
                    times = [time.perf_counter()]
                    factor = factorise(K)
                    times.append(time.perf_counter())
                    x = factor(b)
                    times.append(time.perf_counter())
                error = float((abs(K @ x - b) / (abs(K) @ abs(x) + abs(b))).max())
                seconds = [f"{each:.2f}" for each in np.diff(times)]
                file = f"{factor.cost.file / 2**20:.0f}"
                yield [name, str(K.shape[0]), kind, *seconds, ", ".join(peaks(factor)), file, f"{error:.0e}"]
                del factor


def peaks(factor: Factor) -> list[str]:
    """MiB of a factor, or the largest memory so far of each process of MUMPS."""
    if not isinstance(factor, Mumps):
        return [f"{factor.cost.bytes / 2**20:.0f}"]
    pid = factor._group._process.pid
    ranks = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    found = [re.search(r"VmHWM:\s*(\d+)", Path(f"/proc/{rank}/status").read_text()) for rank in ranks]
    return [f"{int(each[1]) / 2**10:.0f}" for each in found if each]


def least(work: Callable[[], Any]) -> tuple[float, Any]:
    """Least seconds of a function, and its result."""
    seconds, found = np.inf, None
    for _ in range(ROUNDS):
        found = None
        started = time.perf_counter()
        found = work()
        seconds = min(seconds, time.perf_counter() - started)
    return seconds, found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bodies", nargs="*", default=list(BODIES))
    parser.add_argument("--threads", type=int, default=SolverSettings().thread_count)
    parser.add_argument("--counts", action="store_true", help="count modes")
    parser.add_argument("--ranks", type=int, nargs="+", help="numbers of processes of MUMPS")
    given = parser.parse_args()
    heads, lines = ["factorise, s", *(f"{k} columns, s" for k in WIDTHS), "error"], rows(given.bodies, given.threads)
    if given.counts:
        heads, lines = ["s", "processor time, s", "MiB", "modes"], counts(given.bodies, given.threads)
    if given.ranks:
        heads = ["factorise, s", "8 columns, s", "MiB of each process", "MiB in a file", "error"]
        lines = processes(given.bodies, given.ranks)
    heads = ["body", "dofs", "solver", *heads]
    print("| " + " | ".join(heads) + " |\n" + "|---" * len(heads) + "|")
    for line in lines:
        print("| " + " | ".join(line) + " |", flush=True)
