"""sdynpy's Craig-Bampton reduction, dense; it runs in an environment of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import sdynpy as sdpy
from problem import Problem, Report


def main(folder: Path) -> None:
    """Modes, constraint modes and reduced matrices in one call, as sdynpy has it."""
    problem, report = Problem.load(folder), Report()
    n, i = problem.coupling.shape
    # Of the interface's own rows nothing enters the shapes.
    K = sp.bmat([[problem.K, problem.coupling], [problem.coupling.T, sp.identity(i)]]).toarray()
    M = sp.block_diag([problem.M, sp.identity(i)]).toarray()
    K, M = (K + K.T) / 2, (M + M.T) / 2
    dofs = sdpy.coordinate_array(np.arange(1, (n + i) // 3 + 1)[:, None], ["X+", "Y+", "Z+"]).ravel()
    with report.timed("total"):
        system = sdpy.System(dofs, M, K)
        reduced = system.reduce_craig_bampton(np.arange(n, n + i), problem.count)
    report.peak()
    T = reduced.transformation
    X, Psi = T[:n, : problem.count], T[:n, problem.count :]
    lam = np.einsum("ij,ij->j", X, problem.K @ X) / np.einsum("ij,ij->j", X, problem.M @ X)
    report.check(problem, np.sqrt(lam) / (2 * np.pi), X, Psi)
    report.write(folder / "report.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
