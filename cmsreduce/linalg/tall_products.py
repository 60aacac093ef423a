"""Products of tall blocks of vectors, whose rows are many and whose columns few."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.compiled import worth_compiling
from cmsreduce.linalg.pardiso import mkl_library
from cmsreduce.linalg.row_shares import share_rows
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["column_products", "combination", "inner", "inner_of_all", "less", "less_all", "times"]

Array = NDArray[np.float64]

# Columns that are taken from few others in less time than by numpy's BLAS, and how few.
_MANY, _FEW = 24, 24
# Rows that are worked on at a time.
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
    if min(V.shape[1], W.shape[1]) > 1 and worth_compiling(V.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_inner

        if _step(V):
            return streamed_inner([V], W)
        if _step(W):
            return streamed_inner([W], V).T
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


def inner_of_all(blocks: Sequence[Array], W: Array) -> Array:
    """[V_1, V_2, ...]^T W of blocks that lie by rows or by columns."""
    if worth_compiling(W.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_inner

        return streamed_inner(blocks, W)
    return np.vstack([np.empty((0, W.shape[1])), *(inner(V, W) for V in blocks)])


def less(W: Array, V: Array, c: Array) -> Array:
    """W - V c in the memory of W: without a copy it takes a third of the time.

    Parameters
    ----------
    W : (n, k) float64
        By columns or by rows; overwritten.
    V : (n, m) float64
    c : (m, k) float64

    Returns
    -------
    (n, k) float64
    """
    if not c.size:
        return W
    few = c.shape[1] <= _FEW and (c.shape[0] >= _MANY or W.flags.c_contiguous)
    if few and _step(V) and worth_compiling(V.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_less

        return streamed_less(W, [V], c)
    # BLAS takes what lies by columns, or the transpose of what lies by rows.
    turned = not V.flags.f_contiguous
    if W.flags.f_contiguous:
        return np.asarray(la.blas.dgemm(-1.0, V.T if turned else V, c, 1.0, W, trans_a=turned, overwrite_c=True))
    return np.asarray(
        la.blas.dgemm(-1.0, c, V.T if turned else V, 1.0, W.T, trans_a=True, trans_b=not turned, overwrite_c=True)
    ).T


def less_all(W: Array, blocks: Sequence[Array], c: Array) -> Array:
    """W - [V_1, V_2, ...] c in the memory of W, for blocks that lie by rows or by columns."""
    if worth_compiling(W.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_less

        return streamed_less(W, blocks, c)
    first = 0
    for V in blocks:
        W = less(W, V, c[first : first + V.shape[1]])
        first += V.shape[1]
    return W


def combination(blocks: Sequence[Array], S: Array) -> Array:
    """[V_1, V_2, ...] S (n, k), by columns, for one block or more that lie by rows or by columns."""
    n = blocks[0].shape[0]
    if worth_compiling(n):
        from cmsreduce.linalg.streamed_products import streamed_combination

        return streamed_combination(blocks, S)
    return less_all(np.zeros((n, S.shape[1]), order="F"), blocks, -S)


def times(W: Array, C: Array) -> Array:
    """W C in the memory of W (n, m), by rows or by columns, for a matrix C (m, k) with k <= m."""
    if _step(W) and C.size and worth_compiling(W.shape[0]):
        from cmsreduce.linalg.streamed_products import streamed_times

        return streamed_times(W, C)
    for start in range(0, W.shape[0], _ROWS):
        rows = slice(start, start + _ROWS)
        W[rows, : C.shape[1]] = W[rows] @ C
    return W[:, : C.shape[1]]


def column_products(X: Array, Y: Array) -> Array:
    """x_j^T y_j of the columns of two blocks (n, k), some rows at a time: in a third of the time where they lie unlike.

    Returns
    -------
    (k,) float64
    """
    sums = np.zeros((current_settings().thread_count, X.shape[1]))

    def work(thread: int, rows: slice) -> None:
        sums[thread] += np.einsum("ij,ij->j", X[rows], Y[rows])

    share_rows(X.shape[0], _ROWS, work)
    return np.asarray(sums.sum(axis=0))


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
