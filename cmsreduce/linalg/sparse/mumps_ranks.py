"""Work of each rank of the MUMPS backend: it holds rows of the matrices; all ranks factorise and solve together.

Started by ``mpiexec -n RANKS PYTHON mumps_ranks.py FOLDER``, with any interpreter that has petsc4py and numpy: this
file imports nothing else. Orders are lines of the file ``orders`` in the folder; matrices and right-hand sides are
files beside it. The first rank answers each order with a line of JSON. When its standard input ends, all ranks end.
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

# Debian's folder of petsc4py, for interpreters that do not search it.
_DEBIAN = Path("/usr/lib/petscdir"), "petsc*/*-real*/lib/python3/dist-packages"
# Seconds after which an idle rank reads the orders again, and their upper limit: each pause is twice the one before.
# MPI's own waiting would take a whole core.
_PAUSE, _LONGEST_PAUSE = 2e-4, 5e-3
# Controls of MUMPS: METIS; no scaling, because the matrix is scaled by powers of two, which costs no digits; 30 % more
# memory than estimated; no ScaLAPACK at the root, which does not count negative pivots; detection of zero pivots.
_CONTROLS = {7: 5, 8: 0, 14: 30, 13: 1, 24: 1}
# Infog entries: error, negative pivots, entries of the whole factor, MiB of all ranks, zero pivots.
_ERROR, _NEGATIVE, _ENTRIES, _MIB, _ZERO = 1, 12, 29, 19, 28
_MILLION = -1_000_000


def petsc() -> Any:
    """PETSc, imported from petsc4py.

    Raises
    ------
    ImportError
        If petsc4py is missing, or if it has complex scalars.
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
    """Share of one rank in the matrices and their factors.

    Parameters
    ----------
    PETSc : module
        PETSc of petsc4py.
    folder : Path
        Folder of the exchanged files.
    """

    def __init__(self, PETSc: Any, folder: Path) -> None:
        self.PETSc, self.folder = PETSc, folder
        self.comm = PETSc.COMM_WORLD
        self._factors: dict[str, tuple[Any, Any, Any]] = {}

    def factorise(self, name: str) -> dict[str, Any]:
        """Factorise the matrix in the files ``NAME.*.npy``; each rank reads its own rows."""
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
        self._factors[name] = matrix, pc, factor
        entries = int(factor.getMumpsInfog(_ENTRIES))
        return {
            "negative": int(factor.getMumpsInfog(_NEGATIVE)),
            "zero": int(factor.getMumpsInfog(_ZERO)),
            # Above an int32 MUMPS returns the negative number of millions.
            "entries": entries if entries >= 0 else entries * _MILLION,
            "mib": int(factor.getMumpsInfog(_MIB)),
        }

    def solve(self, name: str, k: str) -> dict[str, Any]:
        """Solve for the block of ``k`` columns in the file ``NAME.b``, stored by rows, and write ``NAME.x``."""
        matrix, _, factor = self._factors[name]
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
        """Free a factor."""
        for each in self._factors.pop(name, ())[1::-1]:
            each.destroy()
        return {}

    def _own(self, n: int) -> tuple[int, int]:
        """First row of this rank, and the first of the next."""
        size, rank = self.comm.size, self.comm.rank
        return rank * n // size, (rank + 1) * n // size


def _end_with_input(folder: Path) -> None:
    """End the rank at once when its input ends: the process that started the ranks is gone."""
    while sys.stdin.buffer.read(1):
        pass
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


def _answer(answer: dict[str, Any]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")
    sys.stdout.flush()


def main(folder: Path) -> None:
    """Carry out orders until the order "end"."""
    PETSc = petsc()
    ranks, first = Ranks(PETSc, folder), PETSc.COMM_WORLD.rank == 0
    if first:
        threading.Thread(target=_end_with_input, args=(folder,), daemon=True).start()
        _answer({"ranks": PETSc.COMM_WORLD.size})
    with (folder / "orders").open() as orders:
        pause, line = _PAUSE, ""
        while True:
            line += orders.readline()
            if not line.endswith("\n"):
                time.sleep(pause)
                pause = min(2 * pause, _LONGEST_PAUSE)
                continue
            order, *arguments = line.split()
            pause, line = _PAUSE, ""
            if order == "end":
                return
            answer = getattr(ranks, order)(*arguments)
            if first:
                _answer(answer)


if __name__ == "__main__":
    if sys.argv[1:]:
        main(Path(sys.argv[1]))
    else:
        petsc()
