"""What each rank of the MUMPS backend does: keep rows of matrices, factorise them together, solve.

Run by ``mpiexec -n RANKS PYTHON mumps_ranks.py FOLDER`` in any interpreter that has petsc4py and numpy: nothing else is
imported. Orders are lines of the file ``orders`` in the folder, matrices and right-hand sides are files beside it; the
first rank answers each order with a line of JSON. When its standard input ends, so do all ranks.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

# Where Debian's packages put petsc4py, for interpreters that its alternatives system did not tell.
_DEBIAN = Path("/usr/lib/petscdir"), "petsc*/*-real*/lib/python3/dist-packages"
# An idle rank looks for orders after so many seconds, later each time up to the second figure: MPI's own waiting would
# take a whole core.
_LOOK, _LOOK_AT_MOST = 2e-4, 5e-3
# MUMPS: METIS; no scaling, for what comes is scaled by powers of two, which cost no digit; 30 % more room than it
# estimates; no ScaLAPACK at the root, which counts no negative pivots; zero pivots are found.
_CONTROLS = {7: 5, 8: 0, 14: 30, 13: 1, 24: 1}
# Infog entries: error, negative pivots, entries of the factor in all, its MiB over all ranks, zero pivots.
_ERROR, _NEGATIVE, _ENTRIES, _MIB, _ZERO = 1, 12, 29, 19, 28
_MILLION = -1_000_000


def petsc() -> Any:
    """PETSc as petsc4py has it.

    Raises
    ------
    ImportError
        If petsc4py is not there, or without MUMPS, or for complex numbers.
    """
    folder, pattern = _DEBIAN
    sys.path += map(str, sorted(folder.glob(pattern)))
    import petsc4py

    petsc4py.init(["mumps_ranks", "-options_left", "no"])
    from petsc4py import PETSc

    if PETSc.ScalarType is not np.float64:
        raise ImportError("its scalars are not real numbers in double precision")
    return PETSc


class Ranks:
    """The share of one rank of the matrices and their factors.

    Parameters
    ----------
    PETSc : module
        petsc4py's.
    folder : Path
        Where files are exchanged.
    """

    def __init__(self, PETSc: Any, folder: Path) -> None:
        self.PETSc, self.folder = PETSc, folder
        self.comm = PETSc.COMM_WORLD
        self.kept: dict[str, tuple[Any, Any, Any]] = {}

    def factorise(self, name: str) -> dict[str, Any]:
        """Factorise the matrix of some files; every rank reads its own rows."""
        starts = np.load(self.folder / f"{name}.starts.npy", mmap_mode="r")
        columns = np.load(self.folder / f"{name}.columns.npy", mmap_mode="r")
        values = np.load(self.folder / f"{name}.values.npy", mmap_mode="r")
        n = starts.size - 1
        low, high = self._own(n)
        own = slice(int(starts[low]), int(starts[high]))
        kind = self.PETSc.IntType
        matrix = self.PETSc.Mat().createAIJ(
            size=((high - low, n), (high - low, n)),
            csr=((starts[low : high + 1] - starts[low]).astype(kind), columns[own].astype(kind), np.array(values[own])),
            comm=self.comm,
        )
        matrix.setOption(self.PETSc.Mat.Option.SYMMETRIC, True)
        pc = self.PETSc.PC().create(self.comm)
        pc.setOperators(matrix)
        pc.setType(self.PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        pc.setFactorSetUpSolverType()
        factor = pc.getFactorMatrix()
        for control, value in _CONTROLS.items():
            factor.setMumpsIcntl(control, value)
        pc.setUp()
        error = int(factor.getMumpsInfog(_ERROR))
        if error < 0:
            return {"error": error, "detail": int(factor.getMumpsInfog(2))}
        self.kept[name] = matrix, pc, factor
        entries = int(factor.getMumpsInfog(_ENTRIES))
        return {
            "negative": int(factor.getMumpsInfog(_NEGATIVE)),
            "zero": int(factor.getMumpsInfog(_ZERO)),
            # Beyond an int32 MUMPS counts in millions, with a minus sign.
            "entries": entries if entries >= 0 else entries * _MILLION,
            "mib": int(factor.getMumpsInfog(_MIB)),
        }

    def solve(self, name: str, k: str) -> dict[str, Any]:
        """Solve for the block of columns in the file ``NAME.b``, into ``NAME.x``; rows one after the other."""
        matrix, _, factor = self.kept[name]
        n, columns = matrix.getSize()[0], int(k)
        low, high = self._own(n)
        at = 8 * low * columns
        b = np.fromfile(self.folder / f"{name}.b", np.float64, (high - low) * columns, offset=at)
        size = (high - low, n), (None, columns)
        B = self.PETSc.Mat().createDense(size, array=np.asfortranarray(b.reshape(-1, columns)), comm=self.comm)
        X = self.PETSc.Mat().createDense(size, array=np.zeros((high - low, columns), order="F"), comm=self.comm)
        factor.matSolve(B, X)
        with (self.folder / f"{name}.x").open("r+b") as file:
            file.seek(at)
            np.ascontiguousarray(X.getDenseArray()).tofile(file)
        for block in (B, X):
            block.destroy()
        self.comm.barrier()
        return {}

    def free(self, name: str) -> dict[str, Any]:
        """Let go of a factor."""
        for each in self.kept.pop(name, ())[1::-1]:
            each.destroy()
        return {}

    def _own(self, n: int) -> tuple[int, int]:
        """First row of this rank, and the first of the next."""
        size, rank = self.comm.size, self.comm.rank
        return rank * n // size, (rank + 1) * n // size


def _end_with_input(folder: Path) -> None:
    """End at once when nobody is left to ask: the process that started the ranks is gone, however it went."""
    while sys.stdin.buffer.read(1):
        pass
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _say(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main(folder: Path) -> None:
    """Carry out orders until the last."""
    PETSc = petsc()
    ranks, first = Ranks(PETSc, folder), PETSc.COMM_WORLD.rank == 0
    if first:
        threading.Thread(target=_end_with_input, args=(folder,), daemon=True).start()
        _say({"ranks": PETSc.COMM_WORLD.size})
    with (folder / "orders").open() as orders:
        pause, line = _LOOK, ""
        while True:
            line += orders.readline()
            if not line.endswith("\n"):
                time.sleep(pause)
                pause = min(2 * pause, _LOOK_AT_MOST)
                continue
            order, *arguments = line.split()
            pause, line = _LOOK, ""
            if order == "end":
                return
            answer = getattr(ranks, order)(*arguments)
            if first:
                _say(answer)


if __name__ == "__main__":
    if sys.argv[1:]:
        main(Path(sys.argv[1]))
    else:
        petsc()
