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

__all__ = ["part", "share_order", "shifted_matrix"]


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
    # Columns are cut out at once, rows entry by entry.
    inner, order = sp.csc_array(A[:, rows][rows]), share_order(A) if order is None else order
    if order is not None:
        place = np.full(A.shape[0], -1, dtype=np.int64)
        place[rows] = np.arange(rows.size)
        sequence = place[order]
        current_settings().orders.store(*nonzero_pattern(inner), sequence[sequence >= 0])
    return inner


def shifted_matrix(K: sp.csc_array, M: sp.csc_array, sigma: float) -> sp.csc_array:
    """K - sigma M (n, n); a large one shares the pattern of K where that holds the pattern of M."""
    if K.shape[0] < LARGE or not installed("multifrontal"):
        return sp.csc_array(K - sigma * M)
    # Imported here: compiled loops take half a second to load, which small bodies do not need.
    from cmsreduce.multifrontal import shifted

    return shifted(K, M, sigma)
