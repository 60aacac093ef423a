"""cmsreduce: the only file of the benchmarks that knows what its linear algebra is called."""

from __future__ import annotations

import sys
from pathlib import Path

# Before numpy: it tells OpenBLAS's threads to sleep when they have nothing to do.
import cmsreduce  # noqa: F401  isort: skip

import numpy as np
import scipy.sparse as sp
from problem import Problem, Report

from cmsreduce.linalg.eigenpairs import certified_modes, count_below
from cmsreduce.linalg.factorise import factorise

TOLERANCE = 1e-8
"""What the peers are asked for; cmsreduce's own default is finer."""


def main(folder: Path) -> None:
    """Factorise, solve for the constraint modes, find the modes, and count them once more for their price."""
    problem, report = Problem.load(folder), Report()
    K, M = sp.csc_array(problem.K), sp.csc_array(problem.M)
    omega = 2 * np.pi * problem.cutoff_hz
    # Counted first, as a reduction does it: one factor is in memory at a time.
    with report.timed("certificate"):
        count = count_below(K, M, omega)
    with report.timed("factorise"):
        factor = factorise(K, what="K with the interface held")
    with report.timed("solves"):
        Psi = -factor(problem.coupling.toarray())
    calls: list[int] = []

    def solve(b: np.ndarray) -> np.ndarray:
        calls.append(1 if b.ndim == 1 else b.shape[1])
        with report.timed("modes_solves"):
            return factor(b)

    with report.timed("modes"):
        modes = certified_modes(K, M, omega, solve=solve, count=count, tolerance=TOLERANCE)
    report.peak()
    report.facts |= cost(factor) | {"passes": len(calls), "columns": sum(calls)}
    report.facts |= {"bound": float(modes.bound.max()), "counted": count}
    report.check(problem, modes.omega / (2 * np.pi), modes.Phi, Psi)
    report.write(folder / "report.json")


def cost(factor: object) -> dict[str, object]:
    """What the factorisation took, as far as the factor tells."""
    spent = getattr(factor, "cost", None)
    return {
        "backend": getattr(factor, "backend", None),
        "flops": getattr(spent, "flops", None),
        "factor_nnz": getattr(spent, "nnz", None),
        "factor_bytes": getattr(spent, "bytes", None),
    }


if __name__ == "__main__":
    main(Path(sys.argv[1]))
