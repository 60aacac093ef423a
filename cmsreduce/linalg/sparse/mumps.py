"""Backend MUMPS by PETSc on several processes, for bodies whose factor is too large for one process."""

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

# The system's interpreter, for which Debian installs petsc4py.
_SYSTEM_PYTHON = "/usr/bin/python3"
_SCRIPT = Path(mumps_ranks.__file__)
# Bytes for each entry of the factor, with the fronts and their work space: 14 in one process and 17 in two for a solid
# of 3e4 dofs, a little more with more processes.
_BYTES = 18.0
# MUMPS's errors: lack of memory of several kinds; a matrix that is singular by its structure or by its numbers.
_NO_MEMORY, _SINGULAR = (-8, -9, -11, -13, -14, -15, -19, -20), (-6, -10)
# Columns, steps and seed of the block inverse iteration that finds the motion which a matrix resists least.
_COLUMNS, _STEPS, _SEED = 4, 6, 5
# Characters shown of the last output of the processes; seconds that they have to end by themselves.
_TAIL, _END_SECONDS = 2000, 10.0


class Mumps(Factor):
    """L D L^T factors on several processes, pivots of one or two rows.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite; MUMPS pivots in both cases.
    admit : callable
        Refuses a factor that is too large; the size is that in METIS order.

    Raises
    ------
    SingularFactorError
        If a pivot is zero.
    MatrixError
        If petsc4py or mpiexec is missing, or if a process ends.

    Notes
    -----
    MUMPS counts negative pivots, also in pivots of two rows: the inertia is always known. It shows no pivots; `weakest`
    finds the smallest one by inverse iteration.
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
        self._name, answer = self._group.factorise(sp.csc_array(scale @ A @ scale))
        weakref.finalize(self, self._group.free, self._name)
        if answer.get("error", 0) in _NO_MEMORY:
            raise MemoryError(
                f"MUMPS could not allocate memory for the factor of {A.shape[0]} rows (its error {answer['error']})"
            )
        if answer.get("error", 0) in _SINGULAR or answer.get("zero"):
            raise SingularFactorError
        if "error" in answer:
            raise MatrixError(f"MUMPS stopped on {A.shape[0]} rows (its error {answer['error']}, {answer['detail']})")
        super().__init__(A, FactorCost(int(answer["entries"]), cost.flops, float(answer["mib"]) * 2**20))
        self._negative = int(answer["negative"])

    @property
    def pivots(self) -> NDArray[np.float64]:
        """Not available.

        Raises
        ------
        MatrixError
            Always: MUMPS does not show its pivots.
        """
        raise MatrixError("MUMPS does not show its pivots; use `weakest`")

    @cached_property
    def weakest(self) -> tuple[int, float]:
        """Row that is held least, and the share of its diagonal entry that remains when all other rows are free.

        Notes
        -----
        The share is 1 / (a_ii (A^-1)_ii), the pivot ratio of a row that is eliminated last. The row is the one that
        moves most in the motion with the least resistance. If the matrix has a negative pivot, the second value is the
        lowest Rayleigh quotient, which is negative.
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
        """True: MUMPS counts negative pivots, or the factorisation stops."""
        return True

    def _negative_pivots(self) -> int:
        return self._negative

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        scale = self._scale[:, None]
        return scale * self._group.solve(self._name, scale * by_columns(b))


def mumps_lacks(python: str | None = None) -> str:
    """Missing programs for MUMPS, as a message; empty if nothing is missing.

    Parameters
    ----------
    python : str, optional
        Interpreter that has petsc4py; this one or the system's if absent.
    """
    return _found(python)[2]


@cache
def _found(python: str | None) -> tuple[str, str, str]:
    """Interpreter with petsc4py, its mpiexec, and a message of what is missing."""
    missing = ""
    for candidate in (sys.executable, _SYSTEM_PYTHON) if python is None else (python,):
        path = shutil.which(candidate)
        if path is None:
            missing = missing or f"there is no interpreter {candidate}"
            continue
        probe = subprocess.run([path, str(_SCRIPT)], env=_environment(1), capture_output=True, text=True, check=False)
        if probe.returncode:
            missing = f"{path} cannot load petsc4py ({(probe.stderr.strip().splitlines() or ['it ended'])[-1]})"
            continue
        # The MPI of a wheel lies beside its interpreter and needs its own mpiexec.
        mpiexec = shutil.which("mpiexec", path=str(Path(path).parent)) or shutil.which("mpiexec")
        return path, mpiexec or "", "" if mpiexec else "there is no mpiexec on the PATH"
    return "", "", missing


def _environment(threads: int) -> dict[str, str]:
    """Environment of the ranks; it lets MPI run as root, and more ranks than cores."""
    own = {"OMP_NUM_THREADS": str(threads), "OPENBLAS_NUM_THREADS": str(threads)}
    open_mpi = {"OMPI_MCA_rmaps_base_oversubscribe": "1", "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe"}
    if hasattr(os, "geteuid") and os.geteuid() == 0:
        for name in ("OMPI_ALLOW_RUN_AS_ROOT", "PRTE_ALLOW_RUN_AS_ROOT"):
            open_mpi |= {name: "1", f"{name}_CONFIRM": "1"}
    return {**os.environ, **open_mpi, **own}


class _Group:
    """Processes that wait for orders; they end when this process ends, also if it is killed."""

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
            # Signals of the terminal go to this process alone.
            start_new_session=True,
        )
        self._names = (f"A{number}" for number in count())
        weakref.finalize(self, _end, self._process, self.folder, os.getpid())
        self._answer("start")

    @property
    def alive(self) -> bool:
        """True if the processes still run."""
        return self._process.poll() is None

    def factorise(self, A: sp.csc_array) -> tuple[str, dict[str, Any]]:
        """Factorise a matrix; return the name of the factor and the answer of MUMPS."""
        name = next(self._names)
        parts = {"starts": A.indptr, "columns": A.indices, "values": A.data}
        for part, array in parts.items():
            np.save(self.folder / f"{name}.{part}.npy", array)
        answer = self._order("factorise", name)
        for part in parts:
            (self.folder / f"{name}.{part}.npy").unlink()
        return name, answer

    def solve(self, name: str, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve for a block of columns (n, k)."""
        right, left = (self.folder / f"{name}.{end}" for end in "bx")
        np.ascontiguousarray(b).tofile(right)
        with left.open("wb") as file:
            file.truncate(b.nbytes)
        self._order("solve", name, str(b.shape[1]))
        x = np.fromfile(left, np.float64).reshape(b.shape)
        right.unlink()
        left.unlink()
        return np.asfortranarray(x)

    def free(self, name: str) -> None:
        """Free a factor."""
        if self.alive:
            self._order("free", name)

    def _order(self, order: str, *arguments: str) -> dict[str, Any]:
        with (self.folder / "orders").open("a") as file:
            file.write(" ".join([order, *arguments]) + "\n")
        return self._answer(order)

    def _answer(self, order: str) -> dict[str, Any]:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            self._process.wait()
            self._errors.seek(0)
            output = self._errors.read()[-_TAIL:].strip()
            raise MatrixError(
                f"the processes of MUMPS ended at '{order}' (exit {self._process.returncode}): {output or 'no output'}"
            )
        answer: dict[str, Any] = json.loads(line)
        return answer


def _end(process: subprocess.Popen[str], folder: Path, owner: int) -> None:
    """End the ranks and remove their folder."""
    if os.getpid() != owner:
        return
    if process.poll() is None and (folder / "orders").exists():
        with (folder / "orders").open("a") as file:
            file.write("end\n")
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_SECONDS)
    for end in (process.stdin, process.stdout):
        if end is not None:
            end.close()
    # Closed input ends the ranks at once.
    process.wait()
    shutil.rmtree(folder, ignore_errors=True)


@cache
def _started(ranks: int, python: str | None, threads: int, process: int) -> _Group:
    return _Group(ranks, python, threads)


def _group(ranks: int, python: str | None, threads: int) -> _Group:
    """The processes that work for this one, started at the first call; a forked process starts its own."""
    group = _started(ranks, python, threads, os.getpid())
    if not group.alive:
        _started.cache_clear()
        group = _started(ranks, python, threads, os.getpid())
    return group
