"""Shifted matrix A - s B on the pattern of A, where that holds the pattern of B: a mass within its stiffness."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.multifrontal.elimination import short_indices
from cmsreduce.multifrontal.loops import loop

__all__ = ["shifted"]

Array = NDArray[np.float64]
Rows = NDArray[np.int32]


def shifted(A: sp.csc_array, B: sp.csc_array, s: float) -> sp.csc_array:
    """Combine two matrices, A - s B, in half the time and memory of a sum of any two.

    Parameters
    ----------
    A, B : (n, n) csc array
        float64.
    s : float
        Shift.

    Returns
    -------
    (n, n) csc array
        Shares the arrays of the pattern with A, if its indices are of 32 bits, where A has an entry at each entry of B,
        in ascending rows.

    Examples
    --------
    >>> A = sp.csc_array(np.array([[3.0, 1.0], [1.0, 2.0]]))
    >>> shifted(A, sp.eye_array(2, format="csc"), 2.0).toarray().tolist()
    [[1.0, 1.0], [1.0, 0.0]]
    """
    if A.has_sorted_indices and B.has_sorted_indices and A.data.dtype == B.data.dtype == np.float64:
        A, B, data = short_indices(A), short_indices(B), A.data.copy()
        if _subtract(A.indptr, A.indices, data, B.indptr, B.indices, B.data, s):
            return sp.csc_array((data, A.indices, A.indptr), shape=A.shape)
    return sp.csc_array(A - s * B)


@loop
def _subtract(
    starts: Rows, rows: Rows, data: Array, its_starts: Rows, its_rows: Rows, its_data: Array, s: float
) -> bool:
    """Subtract s times the entries of a second matrix from those of a first one; False if the first lacks a place."""
    for j in range(starts.size - 1):
        p, end = starts[j], starts[j + 1]
        for q in range(its_starts[j], its_starts[j + 1]):
            while p < end and rows[p] < its_rows[q]:
                p += 1
            if p == end or rows[p] != its_rows[q]:
                return False
            data[p] -= s * its_data[q]
    return True
