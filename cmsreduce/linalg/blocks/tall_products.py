"""Products of tall blocks of vectors, whose rows are many and whose columns few."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.machine import add_product, current_settings, share_rows

__all__ = ["column_products", "combination", "inner", "inner_of_all", "less", "less_all", "times"]

Array = NDArray[np.float64]

# Rows that are worked on at a time.
_ROWS = 4096
# Rows from which on MKL is asked, which shares them among threads; numpy's own BLAS takes half as long again.
_TALL = 20_000


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
    found = np.empty((V.shape[1], W.shape[1]), order="F")
    if min(found.shape, default=0) > 1 and _tall(V, found, V.T, W):
        return found
    return np.asarray(V.T @ W)


def inner_of_all(blocks: Sequence[Array], W: Array) -> Array:
    """[V_1, V_2, ...]^T W of blocks that lie by rows or by columns."""
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
    if _tall(V, W, V, c, times=-1.0, keep=1.0):
        return W
    # BLAS takes what lies by columns, or the transpose of what lies by rows.
    turned = not V.flags.f_contiguous
    if W.flags.f_contiguous:
        return np.asarray(la.blas.dgemm(-1.0, V.T if turned else V, c, 1.0, W, trans_a=turned, overwrite_c=True))
    return np.asarray(
        la.blas.dgemm(-1.0, c, V.T if turned else V, 1.0, W.T, trans_a=True, trans_b=not turned, overwrite_c=True)
    ).T


def less_all(W: Array, blocks: Sequence[Array], c: Array) -> Array:
    """W - [V_1, V_2, ...] c in the memory of W, for blocks that lie by rows or by columns."""
    first = 0
    for V in blocks:
        W = less(W, V, c[first : first + V.shape[1]])
        first += V.shape[1]
    return W


def combination(blocks: Sequence[Array], S: Array) -> Array:
    """[V_1, V_2, ...] S (n, k), by columns, for one block or more that lie by rows or by columns."""
    return less_all(np.zeros((blocks[0].shape[0], S.shape[1]), order="F"), blocks, -S)


def times(W: Array, C: Array) -> Array:
    """W C in the memory of W (n, m), by rows or by columns, for a matrix C (m, k) with k <= m."""
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


def _tall(V: Array, C: Array, A: Array, B: Array, *, times: float = 1.0, keep: float = 0.0) -> bool:
    """C = keep C + times A B by MKL, where V is tall; whether it was done."""
    return V.shape[0] >= _TALL and add_product(C, A, B, current_settings().thread_count, times=times, keep=keep)
