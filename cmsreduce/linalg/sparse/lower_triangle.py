"""The lower triangle of a sparse symmetric matrix, column by column, and where it has entries."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["lower_pattern", "lower_triangle"]

Integers = NDArray[np.int32]

# Columns that are looked at at a time: what is set aside is memory that a factor would have to find elsewhere.
_COLUMNS = 4096


def lower_pattern(A: sp.csc_array) -> tuple[Integers, Integers]:
    """Where the lower triangle has entries: zeros are left out, but for those of the diagonal.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.

    Returns
    -------
    starts : (n + 1,) int32
        Where the rows of each column begin.
    rows : int32
        Rows, ascending in each column. Those of K and of K - sigma M agree, which have zeros in different places.
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
    """Values of the lower triangle, their rows and the starts of its columns, as `lower_pattern` has them.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    scale : (n,) float64, optional
        S, for the triangle of S A S.
    real : dtype
        Of the values.
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
    """Some columns, where their entries are, and which of them are kept."""
    n = A.shape[0]
    for first in range(0, n, _COLUMNS):
        columns = slice(first, min(first + _COLUMNS, n))
        entries = slice(int(A.indptr[columns.start]), int(A.indptr[columns.stop]))
        column = np.repeat(
            np.arange(columns.start, columns.stop, dtype=A.indices.dtype),
            np.diff(A.indptr[columns.start : columns.stop + 1]),
        )
        rows = A.indices[entries]
        # Stored zeros would fill the factor, and set K apart from K - sigma M, which has none.
        yield columns, entries, (rows > column) & (A.data[entries] != 0) | (rows == column)


def _lengths(A: sp.csc_array, columns: slice, kept: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Entries of each column that are kept."""
    before = np.concatenate([[0], np.cumsum(kept)])
    starts = A.indptr[columns.start : columns.stop + 1]
    return np.asarray(np.diff(before[starts - starts[0]]))


def _ready(A: sp.csc_array) -> sp.csc_array:
    """The same matrix with sorted rows and every diagonal entry stored."""
    if not A.diagonal().all():
        n = A.shape[0]
        rows = np.arange(n)
        entries = sp.coo_array(A)
        row, column = entries.coords
        data = np.concatenate([entries.data, np.zeros(n)])
        # Adding entries of one place keeps explicit zeros.
        A = sp.csc_array(sp.coo_array((data, (np.concatenate([row, rows]), np.concatenate([column, rows]))), (n, n)))
    return A if A.has_sorted_indices else A.sorted_indices()
