"""Backend MKL PARDISO: supernodal symmetric factors in METIS order, on all threads."""

from __future__ import annotations

import weakref
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns
from cmsreduce.linalg.machine import current_settings, mkl_library, pardiso, pardiso_pivots
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.sparse.lower_triangle import lower_triangle, nonzero_pattern

__all__ = ["Pardiso"]

# Matrix types of PARDISO.
_DEFINITE, _INDEFINITE = 2, -2
# From this number of rows on its integers have 64 bits: 32 bits cannot count the entries of such a factor.
_LONG = 1_500_000
# Phases of PARDISO.
_ANALYSE, _FACTORISE, _SOLVE, _RELEASE = 11, 22, 33, -1
# Error codes of PARDISO.
_NO_MEMORY, _BAD_PIVOT = -2, -4
# From this number of rows on two levels of parallel work are quicker than one.
_TWO_LEVELS = 20_000
# Up to this number of rows a second thread saves nothing and spins for as long: 10 308 rows are factorised in 0.065 s
# on one thread and in 0.07 s on two.
_FEW_ROWS = 12_000
# A pivot is moved away from zero only if it is far below round-off: the count of signs must be that of the matrix.
_PERTURBED = 20
# Index in iparm of the number of moved pivots.
_MOVED = 13
_KIB = 1024.0


class Pardiso(Factor):
    """Cholesky factors L L^T, or L D L^T with pivots of one or two rows (Bunch and Kaufman).

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite.
    admit : callable
        Refuses a factor that is too large.
    scale : (n,) float64, optional
        S, for factors of S A S in float32: half the memory and half the time, seven digits.

    Raises
    ------
    SingularFactorError
        If a pivot is zero, or not positive in a definite matrix.
    MemoryError
        If PARDISO cannot allocate memory.
    MatrixError
        If it stops for another reason.

    Notes
    -----
    Source: Intel oneAPI Math Kernel Library, developer reference, "oneMKL PARDISO": parameters iparm.
    """

    backend: str = "pardiso"

    def __init__(
        self,
        A: sp.csc_array,
        definite: bool,
        admit: Admit,
        scale: NDArray[np.float64] | None = None,
    ) -> None:
        if mkl_library() is None:
            raise MatrixError("the MKL runtime is not installed: pip install mkl, or set solver.backend to superlu")
        self._scale, self._real = scale, np.dtype(np.float64 if scale is None else np.float32)
        # The upper triangle by rows is the lower one by columns. PARDISO needs all diagonal entries, zeros too.
        values, indices, indptr = lower_triangle(A, scale, self._real)
        integer = np.dtype(np.int64 if A.shape[0] > _LONG and scale is not None else np.int32)
        indices, indptr = (part.astype(integer, copy=False) for part in (indices, indptr))
        self._matrix: tuple[NDArray[Any], NDArray[Any], NDArray[Any]] = values, indptr, indices
        orders, pattern = current_settings().orders, nonzero_pattern(A)
        known = orders.find(*pattern)
        self._order = np.zeros(A.shape[0], integer) if known is None else known.astype(integer)
        self._type = _DEFINITE if definite else _INDEFINITE
        self._handle = np.zeros(64, dtype=np.int64)
        self._iparm = _parameters(A.shape[0], scale is not None, known is not None).astype(integer)
        size = A.shape[0]
        self._release = weakref.finalize(self, _release, self._handle, self._iparm.copy(), self._type, size)
        self._call(_ANALYSE, size)
        if known is None:
            orders.store(*pattern, self._order)
        peak, factors, entries = float(self._iparm[15]), float(self._iparm[16]), int(self._iparm[17])
        nnz = entries if entries > 0 else int(factors * _KIB / self._real.itemsize)
        # With two levels PARDISO does not count operations; this estimate is close for solids and frames.
        counted = float(self._iparm[18]) * 1e6
        flops = counted if counted > 0 else 2.0 * nnz**2 / max(size, 1)
        super().__init__(A, FactorCost(nnz, flops, (peak + factors) * _KIB))
        admit(self.cost)
        self._call(_FACTORISE, size)
        if not self._iparm[_MOVED]:
            # Solves read the matrix only to refine solutions after a moved pivot.
            self._matrix = values[:1].copy(), indptr[:1].copy(), indices[:1].copy()

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) for A, not for S A S; in single precision to seven digits."""
        b = by_columns(b)
        if self._scale is None:
            x = np.empty_like(b)
            self._call(_SOLVE, self.n, b, x)
            return x
        size = np.ones(b.shape[1])
        c = np.empty(b.shape, self._real, order="F")
        # Column by column, while it is in the cache: the solve takes little longer than a few passes over memory.
        for j, column in enumerate(b.T):
            scaled = column * self._scale
            # Without this a column of small values would vanish in float32.
            size[j] = max(scaled.max(), -scaled.min()) or 1.0
            np.divide(scaled, size[j], out=c[:, j], casting="same_kind")
        y = np.empty_like(c)
        self._call(_SOLVE, self.n, c, y)
        del c
        x = np.empty(b.shape, order="F")
        for j in range(size.size):
            np.multiply(y[:, j], self._scale, out=x[:, j])
            x[:, j] *= size[j]
        return x

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,); the diagonal of a pivot of two rows."""
        eliminated = np.empty(self.n, self._real)
        with self._in_use:
            code = pardiso_pivots(self._handle, eliminated)
        if code:
            raise _failure("gives no pivots", code)
        pivots = np.empty(self.n)
        pivots[self._order] = eliminated
        return pivots if self._scale is None else np.asarray(pivots / self._scale**2)

    @property
    def inertia_known(self) -> bool:
        """True if no pivot had to be moved away from zero."""
        return int(self._iparm[_MOVED]) == 0

    def _negative_pivots(self) -> int:
        return 0 if self._type == _DEFINITE else int(self._iparm[22])

    def _call(self, phase: int, n: int, b: NDArray[Any] | None = None, x: NDArray[Any] | None = None) -> None:
        threads = current_settings().thread_count if n > _FEW_ROWS else 1
        code = pardiso(self._handle, phase, self._type, n, self._matrix, self._order, self._iparm, b, x, threads)
        if code == _BAD_PIVOT:
            raise SingularFactorError
        if code == _NO_MEMORY:
            raise MemoryError(f"MKL PARDISO could not allocate memory for the factor of {n} rows")
        if code:
            raise _failure(f"stopped in phase {phase} on {n} rows", code)


def _parameters(n: int, single: bool, ordered: bool) -> NDArray[np.int32]:
    iparm = np.zeros(64, dtype=np.int32)
    iparm[0] = 1  # the values below instead of defaults
    iparm[1] = 3  # nested dissection on all threads: most of the time of a small matrix
    iparm[4] = 1 if ordered else 2  # read a known order, or return the new one
    iparm[9] = _PERTURBED
    iparm[17] = iparm[18] = -1  # count entries and operations
    iparm[20] = 1  # pivots of one or two rows
    iparm[23] = 1 if n > _TWO_LEVELS else 0
    iparm[27] = int(single)  # float32
    iparm[34] = 1  # rows count from 0
    iparm[55] = 1  # keep the pivots
    return iparm


def _failure(what: str, code: int) -> MatrixError:
    return MatrixError(
        f"MKL PARDISO {what} (its error {code}); set solver.backend to superlu or cholmod, which take the same matrices"
    )


def _release(handle: NDArray[np.int64], iparm: NDArray[Any], kind: int, n: int) -> None:
    """Free the memory of a factor."""
    nothing = np.zeros(1, dtype=iparm.dtype)
    pardiso(handle, _RELEASE, kind, n, (nothing, nothing, nothing), nothing, iparm)
