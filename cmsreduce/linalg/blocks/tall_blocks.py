"""Tall blocks of vectors, with many rows and few columns: their layout in memory, and products of two of them.

A block is stored by rows for sparse products and searches, and by columns for shapes and solves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import add_product, current_settings, share_rows

__all__ = [
    "by_columns",
    "by_rows",
    "column_products",
    "combination",
    "dense",
    "inner",
    "inner_of_all",
    "less",
    "less_all",
    "put",
    "times",
]

Array = NDArray[np.float64]

# Rows that are copied at a time: few enough that all their columns stay in the cache.
_COPIED_ROWS = 256
# Rows of a product at a time.
_ROWS = 4096
# From this number of rows on MKL shares them among threads; numpy's own BLAS takes one and a half times as long.
_TALL = 20_000
# Blocks of at most so many columns are multiplied some rows at a time: MKL takes 1.4 to 3 times as long.
_NARROW = 16


def by_columns(X: NDArray[Any], real: np.dtype[Any] | type[np.floating[Any]] = np.float64) -> NDArray[Any]:
    """Return a block (n, k) by columns (Fortran order); the block itself if it is.

    A copy by numpy would take six times as long.

    Parameters
    ----------
    X : (n, k) float array
    real : dtype
        Type of the result.

    Returns
    -------
    (n, k) array of ``real``
    """
    if X.strides[0] <= X.strides[1]:
        return np.asfortranarray(X, dtype=real)
    copy = np.empty(X.shape, dtype=real, order="F")
    put(X, copy)
    return copy


def by_rows(X: Array) -> Array:
    """Return a block (n, k) by rows (C order); the block itself if it is."""
    if X.flags.c_contiguous:
        return X
    copy = np.empty(X.shape)
    put(X, copy)
    return copy


def put(X: NDArray[Any], place: NDArray[Any], scale: Array | None = None) -> None:
    """Copy a block (n, k), each column times its ``scale`` (k,), into ``place``, which may have another layout."""

    def work(_: int, rows: slice) -> None:
        place[rows] = X[rows] if scale is None else X[rows] * scale

    share_rows(X.shape[0], _COPIED_ROWS, work)


def inner(V: Array, W: Array) -> Array:
    """Inner products V^T W of two blocks (n, m) and (n, k).

    Parameters
    ----------
    V, W : (n, m), (n, k) float64
        Stored by rows or by columns.

    Returns
    -------
    (m, k) float64
    """
    return inner_of_all([V], W)


def inner_of_all(blocks: Sequence[Array], W: Array) -> Array:
    """Inner products [V_1, V_2, ...]^T W of several blocks with W."""
    widths = [V.shape[1] for V in blocks]
    (n, k), ends = W.shape, np.cumsum([0, *widths]).tolist()
    if n < _TALL or max([k, *widths]) > _NARROW:
        return np.vstack([np.empty((0, k)), *(_inner(V, W) for V in blocks)])
    sums = np.zeros((current_settings().thread_count, ends[-1], k))

    def work(thread: int, rows: slice) -> None:
        part = W[rows]
        for V, first, last in zip(blocks, ends, ends[1:], strict=False):
            sums[thread, first:last] += V[rows].T @ part

    share_rows(n, _ROWS, work)
    return np.asarray(sums.sum(axis=0))


def _inner(V: Array, W: Array) -> Array:
    products = np.empty((V.shape[1], W.shape[1]), order="F")
    if min(products.shape, default=0) > 1 and _tall(V, products, V.T, W):
        return products
    return np.asarray(V.T @ W)


def less(W: Array, V: Array, c: Array) -> Array:
    """Difference W - V c in the memory of W: without a copy it takes a third of the time.

    Parameters
    ----------
    W : (n, k) float64
        Stored by columns or by rows; overwritten.
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
    # BLAS takes a block stored by columns, or the transpose of one stored by rows.
    by_rows = not V.flags.f_contiguous
    if W.flags.f_contiguous:
        return np.asarray(la.blas.dgemm(-1.0, V.T if by_rows else V, c, 1.0, W, trans_a=by_rows, overwrite_c=True))
    return np.asarray(
        la.blas.dgemm(-1.0, c, V.T if by_rows else V, 1.0, W.T, trans_a=True, trans_b=not by_rows, overwrite_c=True)
    ).T


def less_all(W: Array, blocks: Sequence[Array], c: Array) -> Array:
    """Difference W - [V_1, V_2, ...] c in the memory of W."""
    first = 0
    for V in blocks:
        W = less(W, V, c[first : first + V.shape[1]])
        first += V.shape[1]
    return W


def combination(blocks: Sequence[Array], S: Array) -> Array:
    """Combinations [V_1, V_2, ...] S (n, k) of one block or more, stored by columns."""
    return less_all(np.zeros((blocks[0].shape[0], S.shape[1]), order="F"), blocks, -S)


def times(W: Array, C: Array) -> Array:
    """Product W C in the memory of W (n, m), for a matrix C (m, k) with k <= m."""
    for start in range(0, W.shape[0], _ROWS):
        rows = slice(start, start + _ROWS)
        W[rows, : C.shape[1]] = W[rows] @ C
    return W[:, : C.shape[1]]


def column_products(X: Array, Y: Array) -> Array:
    """Inner products x_j^T y_j of the columns of two blocks (n, k), some rows at a time.

    If the two layouts differ, this takes a third of the time of numpy's product.

    Returns
    -------
    (k,) float64
    """
    sums = np.zeros((current_settings().thread_count, X.shape[1]))

    def work(thread: int, rows: slice) -> None:
        sums[thread] += np.einsum("ij,ij->j", X[rows], Y[rows])

    share_rows(X.shape[0], _ROWS, work)
    return np.asarray(sums.sum(axis=0))


def dense(A: Array | sp.sparray) -> Array:
    """Return a small matrix as a dense one: rows of points or reduced coordinates, never all dofs of a full body."""
    return np.asarray(A.toarray() if sp.issparse(A) else A)  # type: ignore[union-attr]


def _tall(V: Array, C: Array, A: Array, B: Array, *, times: float = 1.0, keep: float = 0.0) -> bool:
    """Compute C = keep C + times A B by MKL if V is tall; false if this was not done."""
    return V.shape[0] >= _TALL and add_product(C, A, B, current_settings().thread_count, times=times, keep=keep)
