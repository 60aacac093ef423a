"""Patterns of a sparse symmetric matrix, and the values of its lower triangle, column by column."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["lower_pattern", "lower_triangle", "nonzero_pattern"]

Integers = NDArray[np.int32]

# Columns in a block: temporary arrays take memory that the factor needs.
_COLUMNS = 4096


def nonzero_pattern(A: sp.csc_array) -> tuple[Integers, Integers]:
    """Pattern of both triangles without stored zeros: that of the matrix itself, without a copy, where it stores none.

    By it an order is known: K and K - sigma M have one pattern, although K may store more zeros.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.

    Returns
    -------
    starts : (n + 1,) int32
        Start of each column in ``rows``.
    rows : int32
        Rows, ascending in each column.
    """
    if np.count_nonzero(A.data) < A.nnz:
        A = A.copy()
        A.eliminate_zeros()
    A = A if A.has_sorted_indices else A.sorted_indices()
    return A.indptr.astype(np.int32, copy=False), A.indices.astype(np.int32, copy=False)


def lower_pattern(A: sp.csc_array) -> tuple[Integers, Integers]:
    """Pattern of the lower triangle without stored zeros, except those of the diagonal.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.

    Returns
    -------
    starts : (n + 1,) int32
        Start of each column in ``rows``.
    rows : int32
        Rows, ascending in each column.
    """
    A = _ready(A)
    starts, pieces = np.zeros(A.shape[0] + 1, dtype=np.int32), [np.zeros(0, dtype=np.int32)]
    for columns, entries, kept in _pieces(A):
        pieces.append(A.indices[entries][kept].astype(np.int32, copy=False))
        starts[columns.start + 1 : columns.stop + 1] = _lengths(A, columns, kept)
    return starts.cumsum(dtype=np.int32), np.concatenate(pieces)


def lower_triangle(
    A: sp.csc_array, scale: NDArray[np.float64] | None = None, real: np.dtype[Any] | type[np.floating[Any]] = np.float64
) -> tuple[NDArray[Any], Integers, Integers]:
    """Values of the lower triangle, with their rows and the starts of the columns (`lower_pattern`).

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    scale : (n,) float64, optional
        S, for the triangle of S A S.
    real : dtype
        Type of the values.
    """
    A = _ready(A)
    starts, rows = lower_pattern(A)
    values, done = np.empty(rows.size, dtype=real), 0
    for columns, entries, kept in _pieces(A):
        own = A.data[entries][kept]
        here = slice(done, done := done + own.size)
        if scale is not None:
            own *= scale[rows[here]]
            own *= np.repeat(scale[columns], np.diff(starts[columns.start : columns.stop + 1]))
        values[here] = own
    return values, rows, starts


def _pieces(A: sp.csc_array) -> Iterator[tuple[slice, slice, NDArray[np.bool_]]]:
    """Blocks of columns: the columns, the range of their entries, and a mask of the entries to keep."""
    n = A.shape[0]
    for first in range(0, n, _COLUMNS):
        columns = slice(first, min(first + _COLUMNS, n))
        entries = slice(int(A.indptr[columns.start]), int(A.indptr[columns.stop]))
        column = np.repeat(
            np.arange(columns.start, columns.stop, dtype=A.indices.dtype),
            np.diff(A.indptr[columns.start : columns.stop + 1]),
        )
        rows = A.indices[entries]
        # Stored zeros would cause fill.
        yield columns, entries, (rows > column) & (A.data[entries] != 0) | (rows == column)


def _lengths(A: sp.csc_array, columns: slice, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Number of kept entries in each column."""
    before = np.concatenate([[0], np.cumsum(kept)])
    starts = A.indptr[columns.start : columns.stop + 1]
    return np.asarray(np.diff(before[starts - starts[0]]))


def _ready(A: sp.csc_array) -> sp.csc_array:
    """The same matrix with sorted rows and all diagonal entries stored."""
    if not A.diagonal().all():
        n = A.shape[0]
        rows = np.arange(n)
        entries = sp.coo_array(A)
        row, column = entries.coords
        data = np.concatenate([entries.data, np.zeros(n)])
        # The conversion adds entries at one place and keeps zeros.
        A = sp.csc_array(sp.coo_array((data, (np.concatenate([row, rows]), np.concatenate([column, rows]))), (n, n)))
    return A if A.has_sorted_indices else A.sorted_indices()
