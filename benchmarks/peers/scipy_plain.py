"""scipy as its users write it: splu in its default order, MMD or METIS's, or a factor of cmsreduce; and eigsh."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from problem import Problem, Report

# Asked of eigsh: the residuals are then below 1e-8 on all bodies. Its default, 0, is round-off, and costs more.
TOLERANCE = 1e-8
BORROWED = ("multifrontal", "pardiso")
_SYMMETRIC = {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True, "Equil": False}}


def metis_order(K: sp.csc_matrix) -> np.ndarray:
    """Nested dissection of the nodes, three dofs each."""
    import pymetis

    nodes = sp.bsr_matrix(K, blocksize=(3, 3))
    graph = sp.csr_matrix((np.ones(nodes.indices.size, dtype=np.int8), nodes.indices, nodes.indptr))
    graph.setdiag(0)
    graph.eliminate_zeros()
    order, _ = pymetis.nested_dissection(pymetis.CSRAdjacency(graph.indptr, graph.indices))
    return (3 * np.asarray(order)[:, None] + np.arange(3)).ravel()


def solver(K: sp.csc_matrix, order: str):
    """Solve by splu in the order asked for, or by a backend of cmsreduce: then the factor is that of its own search."""
    if order in BORROWED:
        from ours import borrowed_factor

        return borrowed_factor(K, order)
    if order == "default":
        return spla.splu(K).solve
    if order == "mmd":
        return spla.splu(K, permc_spec="MMD_AT_PLUS_A", **_SYMMETRIC).solve
    p = metis_order(K)
    lu = spla.splu(sp.csc_matrix(K[p][:, p]), permc_spec="NATURAL", **_SYMMETRIC)

    def solve(b: np.ndarray) -> np.ndarray:
        x = np.empty_like(b)
        x[p] = lu.solve(b[p])
        return x

    return solve


def main(folder: Path, order: str) -> None:
    """Factorise, solve for the constraint modes, find the modes."""
    problem, report = Problem.load(folder), Report()
    K, M, n = problem.K, problem.M, problem.K.shape[0]
    if order in BORROWED:
        from ours import loaded

        loaded()
    with report.timed("factorise"):
        solve = solver(K, order)
    calls: list[int] = []
    with report.timed("solves"):
        Psi = solve(-problem.coupling.toarray())
    with report.timed("modes"):

        def timed(b: np.ndarray) -> np.ndarray:
            calls.append(1)
            with report.timed("modes_solves"):
                return solve(np.ravel(b))

        inverse = spla.LinearOperator((n, n), matvec=timed, dtype=float)
        start = np.random.default_rng(7).standard_normal(n)
        lam, X = spla.eigsh(K, k=problem.count, M=M, sigma=0.0, OPinv=inverse, v0=start, tol=TOLERANCE)
    report.facts |= {"passes": len(calls), "columns": len(calls)}
    report.peak()
    report.check(problem, np.sqrt(lam) / (2 * np.pi), X, Psi)
    report.write(folder / "report.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
