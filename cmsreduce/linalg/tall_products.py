"""Products of tall blocks of vectors, whose rows are many and whose columns few."""

from __future__ import annotations

import ctypes

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.compiled import compiled_lacks
from cmsreduce.linalg.pardiso import mkl_library
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["column_products", "inner", "less"]

Array = NDArray[np.float64]

# Rows from which on loops are compiled for it: MKL and numpy's BLAS take twice as long, MKL at some widths ten times.
_STREAMED = 50_000
# Columns that are taken from few others in less time than by numpy's BLAS, and how few.
_MANY, _FEW = 24, 24
# Rows whose products are summed up at a time.
_ROWS = 4096
# Rows from which on MKL is asked: numpy's own BLAS takes half as long again for blocks so tall.
_TALL = 20_000
# Names of the C interface to BLAS.
_BY_COLUMNS, _PLAIN, _TRANSPOSED = 102, 111, 112


def inner(V: Array, W: Array) -> Array:
    """V^T W of two blocks (n, m) and (n, k).

    Parameters
    ----------
    V, W : (n, m), (n, k) float64
        By rows or by columns.

    Returns
    -------
    (m, k) float64
    """
    if min(V.shape[1], W.shape[1]) > 1 and _streamed(V.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_inner

        if _step(V) > 0:
            return streamed_inner(V, W)
        if _step(W) > 0:
            return streamed_inner(W, V).T
    library = mkl_library() if V.shape[0] >= _TALL and min(V.shape[1], W.shape[1]) > 1 else None
    left, right = _step(V), _step(W)
    if library is None or not left or not right:
        return np.asarray(V.T @ W)
    library.MKL_Set_Num_Threads_Local(ctypes.c_int(current_settings().thread_count))
    found = np.empty((V.shape[1], W.shape[1]), order="F")
    # The transpose of what lies by rows lies by columns.
    library.cblas_dgemm(
        *(_BY_COLUMNS, _PLAIN if left < 0 else _TRANSPOSED, _TRANSPOSED if right < 0 else _PLAIN),
        *(found.shape[0], found.shape[1], V.shape[0], ctypes.c_double(1.0)),
        *(_at(V), abs(left), _at(W), abs(right), ctypes.c_double(0.0), _at(found), found.shape[0]),
    )
    return found


def less(W: Array, V: Array, c: Array) -> Array:
    """W - V c in the memory of W: without a copy it takes a third of the time.

    Parameters
    ----------
    W : (n, k) float64
        By columns; overwritten.
    V : (n, m) float64
    c : (m, k) float64

    Returns
    -------
    (n, k) float64
    """
    if not c.size:
        return W
    if c.shape[1] <= _FEW and c.shape[0] >= _MANY and _step(V) > 0 and _streamed(V.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_less

        return streamed_less(W, V, c)
    return np.asarray(la.blas.dgemm(-1.0, V, c, 1.0, W, overwrite_c=True))


def column_products(X: Array, Y: Array) -> Array:
    """x_j^T y_j of the columns of two blocks (n, k), some rows at a time: in a third of the time where they lie unlike.

    Returns
    -------
    (k,) float64
    """
    total = np.zeros(X.shape[1])
    for start in range(0, X.shape[0], _ROWS):
        rows = slice(start, start + _ROWS)
        total += np.einsum("ij,ij->j", X[rows], Y[rows])
    return total


def _streamed(n: int) -> bool:
    """Whether loops are compiled for blocks of so many rows."""
    return n >= _STREAMED and not compiled_lacks()


def _step(V: Array) -> int:
    """Entries from a column to the next, or, negative, from a row to the next; 0 where neither lies together."""
    row, column = (step // V.itemsize for step in V.strides)
    if V.dtype != np.float64:
        return 0
    if row == 1 and column >= V.shape[0]:
        return int(column)
    return -int(row) if column == 1 and row >= V.shape[1] else 0


def _at(array: Array) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)
