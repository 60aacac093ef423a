"""MUMPS by way of PETSc, on as many processes as are asked for: for bodies whose factor one process does not hold."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import weakref
from contextlib import suppress
from functools import cache, cached_property
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns
from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse import mumps_ranks
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.sparse.factor_size import factor_cost
from cmsreduce.linalg.sparse.refined_factor import powers_of_two
from cmsreduce.multifrontal import nested_dissection

__all__ = ["Mumps", "mumps_lacks"]

# Of the system, where Debian's petsc4py is found.
_SYSTEM_PYTHON = "/usr/bin/python3"
_SCRIPT = Path(mumps_ranks.__file__)
# Memory for each entry of the factor, with fronts and room to move them in: 14 bytes in one process and 17 over two, of
# a solid of 3e4 dofs; more processes take a little more.
_BYTES = 18.0
# MUMPS's errors: no memory of several kinds; a matrix that is singular in its structure or its numbers.
_NO_MEMORY, _SINGULAR = (-8, -9, -11, -13, -14, -15, -19, -20), (-6, -10)
# Block inverse iteration that finds the motion which a matrix resists least.
_COLUMNS, _STEPS, _SEED = 4, 6, 5
# Characters shown of what the processes said last; seconds in which they end by themselves.
_TAIL, _PATIENCE = 2000, 10.0


class Mumps(Factor):
    """L D L^T factors on several processes, pivots of one or two rows.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite; MUMPS pivots either way.
    admit : callable
        Refuses a factor that is too large, by its size in the order of METIS.

    Raises
    ------
    SingularFactorError
        If a pivot is zero.
    MatrixError
        If petsc4py or mpiexec is missing, or a process ends.

    Notes
    -----
    MUMPS counts negative pivots, also those of two rows, so that the inertia is known whatever it permutes; it shows no
    pivot. `weakest` finds what a pivot would tell by inverse iteration.
    """

    backend: str = "mumps"

    def __init__(self, A: sp.csc_array, definite: bool, admit: Admit) -> None:
        cost = factor_cost(A, nested_dissection(A), _BYTES)
        admit(cost)
        settings = current_settings()
        threads = max(1, settings.thread_count // settings.ranks)
        self._group = _group(settings.ranks, settings.python, threads)
        self._matrix, self._scale = A, powers_of_two(A.diagonal())
        scale = sp.diags_array(self._scale)
        self._name, told = self._group.factorise(sp.csc_array(scale @ A @ scale))
        weakref.finalize(self, self._group.free, self._name)
        if told.get("error", 0) in _NO_MEMORY:
            raise MemoryError(f"MUMPS found no memory for the factor of {A.shape[0]} rows (its error {told['error']})")
        if told.get("error", 0) in _SINGULAR or told.get("zero"):
            raise SingularFactorError
        if "error" in told:
            raise MatrixError(f"MUMPS stopped on {A.shape[0]} rows (its error {told['error']}, {told['detail']})")
        super().__init__(A, FactorCost(int(told["entries"]), cost.flops, float(told["mib"]) * 2**20))
        self._negative = int(told["negative"])

    @property
    def pivots(self) -> NDArray[np.float64]:
        """None that can be read.

        Raises
        ------
        MatrixError
            Always: MUMPS keeps its pivots to itself.
        """
        raise MatrixError("MUMPS does not show its pivots; ask for the weakest row")

    @cached_property
    def weakest(self) -> tuple[int, float]:
        """Row that is held least, and what is left of its diagonal entry when all other rows are free.

        Notes
        -----
        1 / (a_ii (A^-1)_ii), the pivot ratio of a row that is eliminated last, at the row that moves most in the
        motion resisted least; a negative Rayleigh quotient where there is one.
        """
        if not self.n:
            return 0, 1.0
        if not self.diagonal.all():
            return int(np.argmin(abs(self.diagonal))), 0.0
        size = abs(self.diagonal)
        X = np.random.default_rng(_SEED).standard_normal((self.n, min(_COLUMNS, self.n))) / np.sqrt(size)[:, None]
        quotient = np.zeros(1)
        for _ in range(_STEPS):
            X = self(size[:, None] * X)
            X = la.qr(X * np.sqrt(size)[:, None], mode="economic")[0] / np.sqrt(size)[:, None]
            quotient, Z = la.eigh(X.T @ (self._matrix @ X))
            X = X @ Z
        row = int(np.argmax(abs(X[:, 0]) * np.sqrt(size)))
        if self._negative:
            return row, min(float(quotient[0]), -np.finfo(float).tiny)
        compliance = float(self(np.eye(1, self.n, row)[0])[row])
        return row, 1 / (size[row] * compliance)

    @property
    def inertia_known(self) -> bool:
        """Whether negative pivots are counted: always, or the factorisation would have stopped."""
        return True

    def _negative_pivots(self) -> int:
        return self._negative

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        scale = self._scale[:, None]
        return scale * self._group.solve(self._name, scale * by_columns(b))


def mumps_lacks(python: str | None = None) -> str:
    """What is missing for MUMPS to run: empty where nothing is.

    Parameters
    ----------
    python : str, optional
        Interpreter that has petsc4py; this one or the system's if absent.
    """
    return _found(python)[2]


@cache
def _found(python: str | None) -> tuple[str, str, str]:
    """Interpreter with petsc4py, mpiexec that belongs to it, and what is missing of them."""
    said = ""
    for candidate in (sys.executable, _SYSTEM_PYTHON) if python is None else (python,):
        path = shutil.which(candidate)
        if path is None:
            said = said or f"there is no interpreter {candidate}"
            continue
        asked = subprocess.run([path, str(_SCRIPT)], env=_environment(1), capture_output=True, text=True, check=False)
        if asked.returncode:
            said = f"{path} cannot load petsc4py ({(asked.stderr.strip().splitlines() or ['it ended'])[-1]})"
            continue
        # MPI of a wheel lies beside its interpreter, and only its own mpiexec starts it.
        mpiexec = shutil.which("mpiexec", path=str(Path(path).parent)) or shutil.which("mpiexec")
        return path, mpiexec or "", "" if mpiexec else "there is no mpiexec on the PATH"
    return "", "", said


def _environment(threads: int) -> dict[str, str]:
    """Environment of the ranks: more of them than cores, and as root, are nothing to refuse."""
    own = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
    open_mpi = {"OMPI_MCA_rmaps_base_oversubscribe": "1", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        for name in ("OMPI_ALLOW_RUN_AS_ROOT", "PRTE_ALLOW_RUN_AS_ROOT"):
            open_mpi |= {name: "1", f"{name}_CONFIRM": "1"}
    return {**os.environ, **open_mpi, **own}


class _Group:
    """Processes that wait for orders; they end with this one, however it ends."""

    def __init__(self, ranks: int, python: str | None, threads: int) -> None:
        interpreter, mpiexec, lacks = _found(python)
        if lacks:
            raise MatrixError(
                f"the sparse solver 'mumps' cannot run: {lacks}. Install python3-petsc4py (Debian) or petsc4py with "
                "MUMPS, name its interpreter in solver.python, or set solver.backend to auto"
            )
        self.folder = Path(tempfile.mkdtemp(prefix="cmsreduce-mumps-"))
        (self.folder / "orders").touch()
        self._errors = (self.folder / "errors").open("w+")
        self._process = subprocess.Popen(
            [mpiexec, "-n", str(ranks), interpreter, str(_SCRIPT), str(self.folder)],
            env=_environment(threads),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            # A signal of the terminal is this process's to answer.
            start_new_session=True,
        )
        self._names = (f"A{number}" for number in count())
        weakref.finalize(self, _end, self._process, self.folder, os.getpid())
        self._answer("start")

    @property
    def alive(self) -> bool:
        """Whether orders are still taken."""
        return self._process.poll() is None

    def factorise(self, A: sp.csc_array) -> tuple[str, dict[str, Any]]:
        """Name of the factor of a matrix, and what MUMPS says of it."""
        name = next(self._names)
        parts = {"starts": A.indptr, "columns": A.indices, "values": A.data}
        for part, array in parts.items():
            np.save(self.folder / f"{name}.{part}.npy", array)
        told = self._ask("factorise", name)
        for part in parts:
            (self.folder / f"{name}.{part}.npy").unlink()
        return name, told

    def solve(self, name: str, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution for a block of columns (n, k)."""
        right, left = (self.folder / f"{name}.{end}" for end in "bx")
        np.ascontiguousarray(b).tofile(right)
        with left.open("wb") as file:
            file.truncate(b.nbytes)
        self._ask("solve", name, str(b.shape[1]))
        x = np.fromfile(left, np.float64).reshape(b.shape)
        right.unlink()
        left.unlink()
        return np.asfortranarray(x)

    def free(self, name: str) -> None:
        """Let go of a factor, if anybody still holds it."""
        if self.alive:
            self._ask("free", name)

    def _ask(self, order: str, *arguments: str) -> dict[str, Any]:
        with (self.folder / "orders").open("a") as file:
            file.write(" ".join([order, *arguments]) + "\n")
        return self._answer(order)

    def _answer(self, order: str) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._errors.seek(0)
            said = self._errors.read()[-_TAIL:].strip()
            raise MatrixError(
                f"the processes of MUMPS ended at '{order}' (exit {self._process.returncode}): {said or 'nothing said'}"
            )
        told: dict[str, Any] = json.loads(line)
        return told


def _end(process: subprocess.Popen[str], folder: Path, owner: int) -> None:
    """Tell the ranks to end, and clear up after them."""
    if os.getpid() != owner:
        return
    if process.poll() is None and (folder / "orders").exists():
        with (folder / "orders").open("a") as file:
            file.write("end\n")
        with suppress(subprocess.TimeoutExpired):
            process.wait(_PATIENCE)
    for end in (process.stdin, process.stdout):
        if end is not None:
            end.close()
    # With their input closed they are gone within a moment, whatever they were at.
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


@cache
def _started(ranks: int, python: str | None, threads: int, process: int) -> _Group:
    return _Group(ranks, python, threads)


def _group(ranks: int, python: str | None, threads: int) -> _Group:
    """The processes that serve this one, started when first asked for; a process that forked off has its own."""
    group = _started(ranks, python, threads, os.getpid())
    if not group.alive:
        _started.cache_clear()
        group = _started(ranks, python, threads, os.getpid())
    return group
