"""cmsreduce: the only file of the benchmarks that knows what its linear algebra is called."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from problem import Problem, Report

from cmsreduce.linalg.eigen import beside_modes, certified_modes, count_below
from cmsreduce.linalg.machine import SolverSettings, current_settings, solver_settings
from cmsreduce.linalg.machine.settings import KnownOrders
from cmsreduce.linalg.sparse import factorise
from cmsreduce.linalg.sparse.factorisation import installed_backends
from cmsreduce.multifrontal import CholeskyFactor

TOLERANCE = 1e-8
"""Accuracy demanded of all peers; cmsreduce's own default is finer."""
ON_DISK = 4000.0
"""Bytes a row: less memory than a factor of a large solid takes, and more than the updates beside it."""


def main(folder: Path) -> None:
    """Factorise, solve for the constraint modes, find the modes, and count them once more for their price."""
    problem, report = Problem.load(folder), Report()
    loaded()
    reduce(problem, report)
    report.write(folder / "report.json")


def reduce(problem: Problem, report: Report) -> None:
    """Take the seconds of each step, as a reduction goes through them."""
    K, M = sp.csc_array(problem.K), sp.csc_array(problem.M)
    omega = 2 * np.pi * problem.cutoff_hz
    # Counted first, as a reduction does it: one factor is in memory at a time. Uncounted, the modes have no proof.
    count = problem.count if "uncounted" in sys.argv[2:] else None
    if count is None:
        with report.timed("certificate"):
            count = count_below(K, M, omega)
    # The order that the count found would serve K, too; the peers' factorisations find theirs.
    memory = ON_DISK * K.shape[0] if "on-disk" in sys.argv[2:] else None
    fresh = solver_settings(replace(current_settings(), orders=KnownOrders(), memory=memory))
    with fresh, timed_numeric(report), report.timed("factorise"):
        factor = factorise(K, what="K with the interface held")
    calls: list[int] = []
    # In single precision, solves that are not refined.
    name = "rough" if hasattr(factor, "rough") else "_solve"
    method = getattr(factor, name)

    def solve(b: np.ndarray) -> np.ndarray:
        calls.append(1 if b.ndim == 1 else b.shape[1])
        with report.timed("modes_solves"):
            return method(b)

    setattr(factor, name, solve)
    with report.timed("modes"):
        modes = certified_modes(K, M, omega, solve=factor, count=count, tolerance=TOLERANCE)
    delattr(factor, name)
    with report.timed("solves"):
        Psi = beside_modes(factor, M, modes.omega, modes.Phi)((-problem.coupling).toarray())
    report.peak()
    report.facts |= cost(factor) | {"passes": len(calls), "columns": sum(calls)}
    report.facts |= {"bound": float(modes.bound.max()), "counted": count}
    report.check(problem, modes.omega / (2 * np.pi), modes.Phi, Psi)


@contextmanager
def timed_numeric(report: Report) -> Iterator[None]:
    """Time the numeric phase by itself, where the factor is one of fronts."""
    plain = CholeskyFactor._factorise

    def timed(factor: CholeskyFactor, *given: object) -> float:
        with report.timed("numeric"):
            return plain(factor, *given)

    CholeskyFactor._factorise = timed
    yield
    CholeskyFactor._factorise = plain


def loaded() -> None:
    """Load the libraries, as every peer does before its clock starts; what a machine compiles once is compiled."""
    if "multifrontal" in installed_backends():
        with solver_settings(replace(current_settings(), backend="multifrontal", work=[])):
            factorise(sp.csc_array(sp.eye_array(8)))(np.ones((8, 2)))


def borrowed_factor(K: sp.csc_matrix, backend: str):
    """Factor of one of cmsreduce's backends, for the search of another program."""
    with solver_settings(SolverSettings(backend)):
        return factorise(sp.csc_array(K))


def cost(factor: object) -> dict[str, object]:
    """Time and size of the factorisation, as far as the factor reports them."""
    spent = getattr(factor, "cost", None)
    return {
        "backend": getattr(factor, "backend", None),
        "flops": getattr(spent, "flops", None),
        "factor_nnz": getattr(spent, "nnz", None),
        "factor_bytes": getattr(spent, "bytes", None),
    }


if __name__ == "__main__":
    given = Path(sys.argv[1])
    precision = next((each for each in ("single", "double") if each in sys.argv[2:]), "auto")
    backend = next((each for each in ("multifrontal", "pardiso") if each in sys.argv[2:]), "auto")
    with solver_settings(SolverSettings(backend, precision=precision, scratch=given / "scratch")):
        main(given)
