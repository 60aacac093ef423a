"""Exudyn's Hurty-Craig-Bampton modes, one static mode for each interface dof; it runs in an environment of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from exudyn.FEM import FEMinterface, HCBstaticModeSelection
from problem import Geometry, Problem, Report


def main(folder: Path) -> None:
    """Static modes and eigenmodes in one call, as Exudyn has it."""
    problem, geometry, report = Problem.load(folder), Geometry.load(folder), Report()
    K, n, i = problem.K, problem.K.shape[0], problem.coupling.shape[1]
    fem = FEMinterface()
    # Of the interface's own rows nothing is read but their number.
    fem.stiffnessMatrix = sp.csr_matrix(sp.bmat([[K, problem.coupling], [problem.coupling.T, sp.identity(i)]]))
    fem.massMatrix = sp.csr_matrix(sp.block_diag([problem.M, sp.identity(i)]))
    interior = np.setdiff1d(np.arange(len(geometry.xyz)), np.concatenate([geometry.held, geometry.interface]))
    fem.nodes = {"Position": geometry.xyz[np.concatenate([interior, geometry.interface])]}
    with report.timed("total"):
        fem.ComputeHurtyCraigBamptonModes(
            [np.arange(n // 3, (n + i) // 3)],
            problem.count,
            useSparseSolver=True,
            computationMode=HCBstaticModeSelection.allBoundaryNodes,
            timerTreshold=10**9,
        )
    report.peak()
    X, Psi = fem.modeBasis["matrix"][:n, i:], fem.modeBasis["matrix"][:n, :i]
    # Its eigenvalues are kept as frequencies in Hz or not at all, depending on the version: Rayleigh's are the same.
    lam = np.einsum("ij,ij->j", X, problem.K @ X) / np.einsum("ij,ij->j", X, problem.M @ X)
    report.check(problem, np.sqrt(lam) / (2 * np.pi), X, Psi)
    report.write(folder / "report.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
