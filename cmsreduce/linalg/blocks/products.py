"""Products of a sparse matrix with blocks of vectors, on several threads.

Energies of shapes: Phi^T A Phi, block by block, so that no second basis is ever in memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import SparseMatrix, current_settings, mkl_library, watch_if_large

__all__ = [
    "Product",
    "column_blocks",
    "congruence",
    "symmetric_product",
]

Product = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Product with a vector (n,) or a block of them (n, k)."""

# Entries below which MKL, and a second thread of scipy's routines, cost more than they save. MKL takes 15 ms to load
# and half of scipy's 0.17 ms for 28 000 entries and 32 columns; a small run has two hundred such products.
_FEW_FOR_MKL, _FEW_FOR_THREADS = 20_000, 200_000
# A matrix that stores more zeros than this share of its entries, as an element's mass does between its directions, is
# copied without them; for fewer the copy costs more than it saves.
_ZEROS = 0.5


def symmetric_product(A: sp.csc_array) -> Product:
    """Product of a symmetric matrix with blocks of vectors; each thread has rows of its own, so sums never differ.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric; its columns are read as rows, without a copy unless many of its entries are zeros.

    Returns
    -------
    callable
        X -> A X, (n,) or (n, k).
    """
    columns = sp.csc_array(A)
    if np.count_nonzero(columns.data) < (1 - _ZEROS) * columns.nnz:
        columns = _without_zeros(columns)
    return (mkl_product(columns) if columns.nnz >= _FEW_FOR_MKL else None) or _shared(columns)


def mkl_product(A: sp.csc_array) -> Product | None:
    """Product of a symmetric matrix with blocks of vectors by MKL, four times as quick as scipy's.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric, float64; its columns are read as rows, without a copy.

    Returns
    -------
    callable or None
        X -> A X, (n,) or (n, k); None without MKL, or where its indices do not reach.
    """
    if mkl_library() is None or A.nnz > np.iinfo(np.int32).max or A.data.dtype != np.float64:
        return None
    watch_if_large(A.shape[0])
    try:
        matrix = SparseMatrix(A.indptr.astype(np.int32, copy=False), A.indices.astype(np.int32, copy=False), A.data)
    except ValueError:
        return None

    def product(X: NDArray[np.float64]) -> NDArray[np.float64]:
        X = np.ascontiguousarray(X, dtype=np.float64)
        Y = np.empty_like(X)
        if X.size:
            matrix.multiply(X, Y, current_settings().thread_count)
        return Y

    return product


def _shared(columns: sp.csc_array) -> Product:
    """Product by scipy's routines, each thread with rows of its own."""
    n, threads = columns.shape[0], current_settings().thread_count
    if columns.nnz < _FEW_FOR_THREADS:
        rows = _rows(columns, 0, n)
        return lambda X: np.asarray(rows @ np.ascontiguousarray(X))
    cuts = np.searchsorted(columns.indptr, np.linspace(0, columns.nnz, threads + 1)[1:-1])
    ends = [0, *(int(cut) for cut in cuts), n]
    parts = [_rows(columns, start, stop) for start, stop in pairwise(ends)]

    def product(X: NDArray[np.float64]) -> NDArray[np.float64]:
        X = np.ascontiguousarray(X)
        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(lambda part: part @ X, parts)))

    return product


def _without_zeros(A: sp.csc_array) -> sp.csc_array:
    kept = A.data != 0
    starts = np.concatenate([[0], np.cumsum(kept, dtype=A.indptr.dtype)])[A.indptr]
    return sp.csc_array((A.data[kept], A.indices[kept], starts), shape=A.shape)


def _rows(A: sp.csc_array, start: int, stop: int) -> sp.csr_array:
    """Some rows of a symmetric matrix, sharing its entries."""
    own = slice(A.indptr[start], A.indptr[stop])
    indptr = A.indptr[start : stop + 1] - A.indptr[start]
    return sp.csr_array((A.data[own], A.indices[own], indptr), shape=(stop - start, A.shape[0]))


# Wide enough to read a matrix few times, narrow enough beside the block of right-hand sides of a solve.
_COLUMNS = 32


def column_blocks(m: int) -> Iterator[slice]:
    """Columns of a basis of m shapes, some at a time."""
    return (slice(first, min(first + _COLUMNS, m)) for first in range(0, m, _COLUMNS))


def congruence(A: sp.csc_array | NDArray[np.float64], Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phi^T A Phi of a symmetric matrix.

    Parameters
    ----------
    A : (n, n) array, sparse or dense
        Symmetric.
    Phi : (n, m) float64
        Shapes; they may be on disk.

    Returns
    -------
    (m, m) float64
        Symmetric to the last bit.
    """
    m = Phi.shape[1]
    found, product = np.empty((m, m)), symmetric_product(A) if sp.issparse(A) else A.__matmul__
    for part in column_blocks(m):
        # Of a symmetric matrix half is enough: the basis is read half as often.
        known = slice(part.stop)
        found[known, part] = Phi[:, known].T @ product(Phi[:, part])
        found[part, known] = found[known, part].T
        found[part, part] = (found[part, part] + found[part, part].T) / 2
    return found
