"""Parts of a large matrix, such as the interior of a body, whose orders follow from that of the whole; and shifts."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse.factorisation import LARGE, installed
from cmsreduce.linalg.sparse.lower_triangle import nonzero_pattern
from cmsreduce.multifrontal import dissection_installed, nested_dissection

__all__ = ["hand_down_order", "lend_order", "part", "principal_part", "share_order", "shifted_matrix"]

# Columns in a block: temporary arrays stay in the cache, and take no new memory.
_COLUMNS = 4096


def share_order(A: sp.csc_array, *, borrowed: bool = False) -> NDArray[np.int64] | None:
    """Order a large matrix for its factor and for those of its parts.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    borrowed : bool
        True to take the order of an earlier matrix of as many rows: a mass couples the nodes that a stiffness couples.

    Returns
    -------
    (n,) int64 or None
        Fill-reducing order; None for a matrix of few rows, whose parts are ordered for themselves.

    Notes
    -----
    A body of 1e5 dofs is factorised three times in a run: with its interface held, and at two shifts, for counts of its
    modes. The order takes longer than the numbers of a factor.
    """
    if A.shape[0] < LARGE or not dissection_installed():
        return None
    orders, pattern = current_settings().orders, nonzero_pattern(A)
    order = orders.find(*pattern)
    if order is None:
        order = orders.of_rows(A.shape[0]) if borrowed else None
        order = nested_dissection(A) if order is None else order
        orders.store(*pattern, order)
    return np.asarray(order, dtype=np.int64)


def principal_part(A: sp.csc_array, rows: NDArray[np.integer[Any]]) -> sp.csc_array:
    """Some rows of a matrix and the columns of the same numbers, in one pass over its entries.

    Parameters
    ----------
    A : (n, n) sparse array
    rows : (k,) int
        Ascending.

    Returns
    -------
    (k, k) sparse array
    """
    place = np.full(A.shape[0], -1, dtype=A.indices.dtype)
    place[rows] = np.arange(rows.size)
    # Pages of an array that nothing is written to take no memory: the longest there can be, cut to size afterwards.
    data, row = np.empty(A.nnz), np.empty(A.nnz, dtype=A.indices.dtype)
    starts, done = np.zeros(rows.size + 1, dtype=A.indptr.dtype), 0
    for first in range(0, rows.size, _COLUMNS):
        columns = rows[first : first + _COLUMNS]
        begin, end = A.indptr[columns[0]], A.indptr[columns[-1] + 1]
        found = place[A.indices[begin:end]]
        between = place[columns[0] : columns[-1] + 1] >= 0
        inside = (found >= 0) & np.repeat(between, np.diff(A.indptr[columns[0] : columns[-1] + 2]))
        before = np.concatenate([[0], np.cumsum(inside)])
        starts[first + 1 : first + 1 + columns.size] = done + before[A.indptr[columns + 1] - begin]
        here = slice(done, done := done + int(before[-1]))
        data[here], row[here] = A.data[begin:end][inside], found[inside]
    return sp.csc_array((data[:done], row[:done], starts), shape=(rows.size, rows.size))


def part(A: sp.csc_array, rows: NDArray[np.integer[Any]], order: NDArray[np.int64] | None = None) -> sp.csc_array:
    """Rows and columns of a symmetric matrix; nested dissection of the whole is one of the part, too.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    rows : (k,) int
        Ascending.
    order : (n,) int64, optional
        Result of `share_order`, if known.

    Returns
    -------
    (k, k) sparse array
    """
    inner, order = principal_part(A, rows), share_order(A) if order is None else order
    if order is not None:
        hand_down_order(inner, rows, order)
    return inner


def hand_down_order(inner: sp.csc_array, rows: NDArray[np.integer[Any]], order: NDArray[np.int64]) -> None:
    """Order some rows (k,) of a large matrix, of which ``inner`` (k, k) is made, as the whole is ordered (n,)."""
    place = np.full(order.size, -1, dtype=np.int64)
    place[rows] = np.arange(rows.size)
    sequence = place[order]
    current_settings().orders.store(*nonzero_pattern(inner), sequence[sequence >= 0])


def lend_order(A: sp.csc_array, rows: NDArray[np.int64], other: sp.csc_array) -> None:
    """Order another large matrix (m, m) as A (n, n) is ordered; ``rows`` (n,) are the rows of A in it, -1 for none.

    Rows that A lacks, such as those of tied nodes, come last: an order of their own would take longer than the numbers
    of a factor.
    """
    if (order := share_order(A)) is None or other.shape[0] < LARGE:
        return
    first = rows[order]
    first = first[first >= 0]
    lacking = np.ones(other.shape[0], dtype=bool)
    lacking[first] = False
    current_settings().orders.store(*nonzero_pattern(other), np.concatenate([first, np.flatnonzero(lacking)]))


def shifted_matrix(K: sp.csc_array, M: sp.csc_array, sigma: float) -> sp.csc_array:
    """K - sigma M (n, n); a large one shares the pattern of K where that holds the pattern of M."""
    if K.shape[0] < LARGE or not installed("multifrontal"):
        return sp.csc_array(K - sigma * M)
    # Imported here: compiled loops take half a second to load, which small bodies do not need.
    from cmsreduce.multifrontal import shifted

    return shifted(K, M, sigma)
