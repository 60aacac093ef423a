"""SLEPc's Krylov-Schur, shift-invert by MUMPS or CHOLMOD, of the Debian packages; one process, or mpiexec's."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import petsc4py
import scipy.sparse as sp

petsc4py.init(["slepc", "-mat_mumps_icntl_7", "5"])

from petsc4py import PETSc  # noqa: E402
from problem import Problem, Report, peak_gib  # noqa: E402
from slepc4py import SLEPc  # noqa: E402

# Bound on the residual of the inverted problem, relative to its eigenvalue: the loosest power of ten that leaves
# 1e-8 of K x - lam M x on all bodies.
TOLERANCE = 1e-8


def distributed(A: sp.csc_matrix) -> PETSc.Mat:
    """Rows of a symmetric matrix that belong to this process."""
    comm = PETSc.COMM_WORLD
    n, size, rank = A.shape[0], comm.size, comm.rank
    share = [n // size + (k < n % size) for k in range(size)]
    low = sum(share[:rank])
    pointer = A.indptr[low : low + share[rank] + 1]
    own = slice(pointer[0], pointer[-1])
    matrix = PETSc.Mat().createAIJ(
        size=((share[rank], n), (share[rank], n)), csr=(pointer - pointer[0], A.indices[own], A.data[own])
    )
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    return matrix


def main(folder: Path, package: str, sliced: bool = False) -> None:
    """Factorise, solve for the constraint modes, find the modes: those nearest to zero, or slice by slice."""
    problem, report = Problem.load(folder), Report()
    count, comm = problem.count, PETSc.COMM_WORLD
    K, M = distributed(problem.K), distributed(problem.M)
    coupling = problem.coupling
    if comm.size > 1:
        del problem
    eps = SLEPc.EPS().create()
    eps.setOperators(K, M)
    eps.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    eps.setType(SLEPc.EPS.Type.KRYLOVSCHUR)
    eps.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    eps.setTarget(0.0)
    eps.setDimensions(nev=count)
    eps.setTolerances(tol=TOLERANCE)
    if sliced:
        # MUMPS tells the inertia of a shifted matrix if one process factorises the last block.
        PETSc.Options()["mat_mumps_icntl_13"] = 1
        for A in (K, M):
            A.setOption(PETSc.Mat.Option.SPD, False)
        eps.setWhichEigenpairs(SLEPc.EPS.Which.ALL)
        eps.setInterval(0.0, (2 * np.pi * problem.cutoff_hz) ** 2)
    st = eps.getST()
    st.setType(SLEPc.ST.Type.SINVERT)
    ksp = st.getKSP()
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(PETSc.PC.Type.CHOLESKY)
    pc.setFactorSolverType(package)
    with report.timed("factorise"):
        eps.setUp()
        factor = None if sliced else pc.getFactorMatrix()
    Psi = None
    with report.timed("solves"):
        if sliced:
            coupling = coupling[:, :0]
        low, high = K.getOwnershipRange()
        own = np.asfortranarray(-coupling.tocsr()[low:high].toarray())
        sizes = K.getSizes()[0], (None, own.shape[1])
        if own.shape[1]:
            B = PETSc.Mat().createDense(sizes, array=own)
            Psi = PETSc.Mat().createDense(sizes, array=np.zeros_like(own, order="F"))
            factor.matSolve(B, Psi)
    PETSc.Log.begin()
    with report.timed("modes"):
        eps.solve()
    spent = PETSc.Log.Event("KSPSolve").getPerfInfo()
    report.seconds["modes_solves"] = spent["time"]
    report.facts |= {"passes": spent["count"], "columns": spent["count"]}
    # Summed over the processes, each with its share of the matrices and the whole of what it read.
    memory = PETSc.Vec().createMPI(comm.size)
    memory.set(peak_gib())
    report.peak(memory.sum())
    found = min(eps.getConverged(), count)
    x, gather = K.createVecLeft(), None
    hz, X = np.empty(found), np.empty((K.getSize()[0], found)) if comm.rank == 0 else None
    for k in range(found):
        hz[k] = np.sqrt(eps.getEigenpair(k, x).real) / (2 * np.pi)
        if gather is None:
            gather, whole = PETSc.Scatter.toZero(x)
        gather.scatter(x, whole)
        if comm.rank == 0:
            X[:, k] = whole.array
    if comm.rank == 0:
        statics = Psi.getDenseArray() if Psi is not None and comm.size == 1 else None
        report.check(Problem.load(folder), hz, X, statics)
        report.write(folder / "report.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], "slices" in sys.argv[3:])
