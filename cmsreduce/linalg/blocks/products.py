"""Products of a symmetric sparse matrix with blocks of vectors on several threads, and energies Phi^T A Phi.

Energies are computed block by block, so that memory never holds a second basis.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import SparseMatrix, current_settings, mkl_library, share_rows

__all__ = [
    "Product",
    "Rows",
    "absolute_product",
    "column_blocks",
    "congruence",
    "entrywise_product",
    "mkl_product",
    "one_norm",
    "rows_of",
    "symmetric_product",
    "unchanged_in",
]

Array = NDArray[np.float64]

Product = Callable[[Array], Array]
"""Product with a vector (n,) or a block of vectors (n, k)."""

# Number of entries below which MKL, or a second thread of scipy's routines, costs more than it saves. MKL takes 15 ms
# to load and halves scipy's 0.17 ms for 28 000 entries and 32 columns; a small run has two hundred such products.
_FEW_FOR_MKL, _FEW_FOR_THREADS = 20_000, 200_000
# Share of stored zeros from which on a copy without them pays. The mass of an element has zeros between directions.
_ZEROS = 0.5
# Columns of a matrix that are summed up at a time.
_SUMMED = 4096
# Rows whose changed entries are in memory at a time.
_AT_ONCE = 2048
# Columns in a block: enough to read a matrix only a few times, few beside the right-hand sides of a solve.
_COLUMNS = 32


def symmetric_product(A: sp.csc_array) -> Product:
    """Product of a symmetric matrix with blocks of vectors; the sums do not depend on the number of threads.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric. Its columns are read as rows, without a copy unless many of its entries are zeros.

    Returns
    -------
    callable
        X -> A X, (n,) or (n, k).
    """
    columns = sp.csc_array(A)
    if np.count_nonzero(columns.data) < (1 - _ZEROS) * columns.nnz:
        kept = columns.data != 0
        starts = np.concatenate([[0], np.cumsum(kept, dtype=columns.indptr.dtype)])[columns.indptr]
        columns = sp.csc_array((columns.data[kept], columns.indices[kept], starts), shape=columns.shape)
    return (mkl_product(columns) if columns.nnz >= _FEW_FOR_MKL else None) or _scipy_product(columns)


def mkl_product(A: sp.csc_array) -> Product | None:
    """Product of a symmetric matrix with blocks of vectors by MKL, four times as fast as scipy's.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric, float64. Its columns are read as rows, without a copy.

    Returns
    -------
    callable or None
        X -> A X, (n,) or (n, k); None without MKL, or if the matrix has too many entries for its integers.
    """
    if mkl_library() is None or A.nnz > np.iinfo(np.int32).max or A.data.dtype != np.float64:
        return None
    try:
        matrix = SparseMatrix(A.indptr.astype(np.int32, copy=False), A.indices.astype(np.int32, copy=False), A.data)
    except ValueError:
        return None

    def product(X: Array) -> Array:
        X = np.ascontiguousarray(X, dtype=np.float64)
        Y = np.empty_like(X)
        if X.size:
            matrix.multiply(X, Y, current_settings().thread_count)
        return Y

    return product


def _scipy_product(columns: sp.csc_array) -> Product:
    """Product by scipy's routines; each thread has its own rows."""
    n, threads = columns.shape[0], current_settings().thread_count
    if columns.nnz < _FEW_FOR_THREADS:
        rows = rows_of(columns, 0, n)
        return lambda X: np.asarray(rows @ np.ascontiguousarray(X))
    cuts = np.searchsorted(columns.indptr, np.linspace(0, columns.nnz, threads + 1)[1:-1])
    ends = [0, *(int(cut) for cut in cuts), n]
    parts = [rows_of(columns, start, stop) for start, stop in pairwise(ends)]

    def product(X: Array) -> Array:
        X = np.ascontiguousarray(X)
        with ThreadPoolExecutor(threads) as pool:
            return np.concatenate(list(pool.map(lambda part: part @ X, parts)))

    return product


def absolute_product(A: sp.csc_array) -> Product:
    """Product of the absolute values of a symmetric matrix, (n, n), with blocks of vectors."""
    return entrywise_product(A, lambda part, _: abs(part.data))


class Rows(NamedTuple):
    """Compressed rows of a matrix, without a copy: scipy's own arrays copy parts of larger ones."""

    indptr: NDArray[Any]
    indices: NDArray[Any]
    data: Array


def entrywise_product(A: sp.csc_array, entries: Callable[[Rows, slice], Array]) -> Product:
    """Product of a symmetric matrix, (n, n), whose entries follow from those of another one, with blocks of vectors.

    They are made for a few rows at a time: all of them would take as much memory as the other matrix.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    entries : callable
        Gives the entries (nnz,) that take the place of those of some rows of A, from these rows and their numbers.
    """
    mkl = mkl_library() is not None and A.nnz >= _FEW_FOR_MKL
    mkl = mkl and A.data.dtype == np.float64 and A.indices.dtype == A.indptr.dtype == np.int32

    def product(X: Array) -> Array:
        X, Y = np.ascontiguousarray(X, dtype=np.float64), np.empty(X.shape)
        # One column takes MKL longer than scipy.
        by_mkl = mkl and X.ndim > 1 and X.shape[1] > 1

        def multiply(_: int, rows: slice) -> None:
            indptr = A.indptr[rows.start : rows.stop + 1]
            own = slice(indptr[0], indptr[-1])
            part = Rows(indptr - indptr[0], A.indices[own], A.data[own])
            data = entries(part, rows)
            # MKL may refuse them.
            with suppress(ValueError):
                if by_mkl:
                    SparseMatrix(part.indptr, part.indices, data, A.shape[1]).multiply(X, Y[rows], 1)
                    return
            shape = (part.indptr.size - 1, A.shape[1])
            Y[rows] = np.asarray(sp.csr_array((data, part.indices, part.indptr), shape) @ X)

        share_rows(A.shape[0], _AT_ONCE, multiply)
        return Y

    return product


def rows_of(A: sp.csc_array, start: int, stop: int) -> sp.csr_array:
    """Some rows of a symmetric matrix, without a copy of its entries."""
    own = slice(A.indptr[start], A.indptr[stop])
    indptr = A.indptr[start : stop + 1] - A.indptr[start]
    return sp.csr_array((A.data[own], A.indices[own], indptr), shape=(stop - start, A.shape[0]))


def column_blocks(m: int) -> Iterator[slice]:
    """Columns of a basis of m shapes in blocks of 32."""
    return (slice(first, min(first + _COLUMNS, m)) for first in range(0, m, _COLUMNS))


def congruence(A: sp.csc_array | Array, Phi: Array) -> Array:
    """Energies Phi^T A Phi of shapes in a symmetric matrix.

    Parameters
    ----------
    A : (n, n) array, sparse or dense
        Symmetric.
    Phi : (n, m) float64
        Shapes, in memory or on disk.

    Returns
    -------
    (m, m) float64
        Symmetric to the last bit.
    """
    m = Phi.shape[1]
    energies, product = np.empty((m, m)), symmetric_product(A) if sp.issparse(A) else A.__matmul__
    for part in column_blocks(m):
        # Half of a symmetric matrix is enough: the basis is read half as often.
        known = slice(part.stop)
        energies[known, part] = Phi[:, known].T @ product(Phi[:, part])
        energies[part, known] = energies[known, part].T
        energies[part, part] = (energies[part, part] + energies[part, part].T) / 2
    return energies


def one_norm(A: sp.csc_array) -> float:
    """1-norm, some columns at a time: the absolute values of all entries would double the memory."""
    sums = [0.0]
    for first in range(0, A.shape[1], _SUMMED):
        starts = A.indptr[first : first + _SUMMED + 1]
        filled = starts[:-1][np.diff(starts) > 0]
        if filled.size:
            sizes = abs(A.data[starts[0] : starts[-1]])
            sums.append(float(np.add.reduceat(sizes, filled - starts[0]).max()))
    return max(sums)


def unchanged_in(A: sp.csc_array, order: NDArray[np.int64], least: float) -> bool:
    """True if a symmetric matrix is the same with its rows and columns in another order.

    A product with random numbers tells, without a copy of the matrix.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    order : (n,) int64
        Numbers of its rows in the other order.
    least : float
        Difference of an entry, relative to sqrt(A_ii A_jj), which is none.
    """
    columns = sp.csc_array(A)
    own = np.sqrt(abs(columns.diagonal()))
    size = np.maximum(own, own[order])
    z = np.random.default_rng(1).uniform(1.0, 2.0, own.size) / np.where(size > 0, size, 1.0)
    moved = np.empty(own.size)
    moved[order] = z
    return bool((abs((columns.T @ moved)[order] - columns.T @ z) <= least * size).all())
