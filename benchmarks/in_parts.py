"""A body reduced as a whole and in parts, in one run: same modes, time and memory as ratios.

``python benchmarks/in_parts.py [BODY] [PARTS ...]`` prints the table of docs/large-bodies.md; each line is a process of
its own, whose peak memory is the system's figure. ``0`` keeps no factor of a part: the least memory.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import BODIES, problem  # noqa: E402
from cmsreduce.linalg import multilevel, parted_factor  # noqa: E402
from cmsreduce.linalg.eigenpairs import certified_modes, count_below  # noqa: E402
from cmsreduce.linalg.factorise import factorise  # noqa: E402
from cmsreduce.linalg.parted_factor import PartedFactor  # noqa: E402
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings  # noqa: E402


def measured(name: str, parts: int, keep: bool) -> dict[str, object]:
    """Reduce a body in this process: seconds of each step, peak memory beyond the matrices, frequencies."""
    case, _ = problem(name)
    K, M, omega = case.K, case.M, 2 * np.pi * case.cutoff_hz
    coupling = case.coupling.toarray()
    before = resident()
    if not keep:
        parted_factor._KEPT = 0.0
    start_error = None
    with solver_settings(SolverSettings("auto", parts=parts)):
        seconds, clock = {}, time.perf_counter()

        def lap(step: str) -> None:
            nonlocal clock
            seconds[step] = time.perf_counter() - clock
            clock = time.perf_counter()

        count = count_below(K, M, omega)
        lap("count")
        solve = factorise(K)
        lap("factorise")
        Psi = -solve(coupling)
        lap("solves")
        modes = certified_modes(K, M, omega, solve=solve, count=count)
        lap("modes")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        size = solve.cost.bytes
        if isinstance(solve, PartedFactor):
            X = multilevel.multilevel_shapes(K, M, omega, modes.omega.size, solve)
            lam = np.sort(np.linalg.eigvals(np.linalg.solve(X.T @ (M @ X), X.T @ (K @ X))).real)[: modes.omega.size]
            start_error = float((np.sqrt(lam) / modes.omega - 1).max())
    return {
        "n": K.shape[0],
        "count": count,
        "omega": modes.omega.tolist(),
        "bound": float(modes.bound.max()),
        "seconds": seconds,
        "beyond": peak - before,
        "factor": size,
        "start": start_error,
        "boundary": (coupling.T @ Psi).tolist(),
    }


def resident() -> float:
    """Bytes in memory now."""
    return float(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Measure every line in a process of its own, then print."""
    name = sys.argv[1] if sys.argv[1:] else "bar-1e5"
    numbers = [int(text) for text in sys.argv[2:]] or [1, 4, 8, 16]
    asked = [(parts, keep) for parts in numbers for keep in ((True,) if parts == 1 else (True, False))]
    lines = []
    for parts, keep in asked:
        code = f"from benchmarks.in_parts import *; print(json.dumps(measured({name!r}, {parts}, {keep})))"
        done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
        lines.append(json.loads(done.stdout.splitlines()[-1]))
    whole = lines[0]
    print(f"{BODIES[name].title}, {whole['n']} dofs, {whole['count']} modes counted\n")
    print(
        "| parts | factors kept | time | count | factorise | solves | modes | factor | memory | frequencies | bound |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    total = sum(whole["seconds"].values())
    for (parts, keep), line in zip(asked, lines, strict=True):
        times = " | ".join(f"{line['seconds'][s] / total:.2f}" for s in ("count", "factorise", "solves", "modes"))
        off = abs(np.array(line["omega"]) / whole["omega"] - 1).max()
        stiff = abs(np.array(line["boundary"]) - whole["boundary"]).max() / np.abs(whole["boundary"]).max()
        print(
            f"| {parts} | {'all' if keep else 'none'} | {sum(line['seconds'].values()) / total:.2f} | {times} | "
            f"{line['factor'] / whole['factor']:.2f} | {line['beyond'] / whole['beyond']:.2f} | {off:.0e} | "
            f"{line['bound']:.0e} | {line['start'] or 0:.1e} | {stiff:.0e} | "
            f"{line['count'] == whole['count']} |"
        )


if __name__ == "__main__":
    main()
