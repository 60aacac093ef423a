"""Products of tall blocks of vectors, whose rows are many and whose columns few."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.pardiso import mkl_library
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["inner"]

Array = NDArray[np.float64]

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
