"""Where a sparse symmetric matrix has entries, apart from zeros that are stored."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.loops import loop

__all__ = ["couplings"]

Starts = NDArray[np.int64]
Indices = NDArray[np.int32]


def couplings(A: sp.csc_array) -> tuple[Starts, Indices]:
    """Rows that each row of a symmetric matrix is coupled with, itself left out, in compressed form.

    Parameters
    ----------
    A : (n, n) csc array
        An entry that is not zero in one triangle alone, as rounding leaves some, couples too.

    Returns
    -------
    starts : (n + 1,) int64
    indices : int32
        Some may occur twice.
    """
    starts, indices = _couplings(A.indptr, A.indices, A.data, not _mirrored(A.indptr, A.indices, A.data))
    return starts, indices


@loop
def _mirrored(starts: Indices, indices: Indices, data: NDArray[np.float64]) -> bool:
    """Whether entries that are not zero have their mirror images, by sums over both triangles that would differ."""
    lower, upper = np.uint64(0), np.uint64(0)
    for j in range(starts.size - 1):
        for p in range(starts[j], starts[j + 1]):
            i = indices[p]
            if data[p] != 0:
                if i > j:
                    lower += _mixed(i, j)
                elif i < j:
                    upper += _mixed(j, i)
    return bool(lower == upper)


@loop
def _mixed(i: int, j: int) -> np.uint64:
    """Number of an ordered pair (the finalizer of splitmix64)."""
    x = (np.uint64(i) << np.uint64(32)) ^ np.uint64(j)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@loop
def _couplings(starts: Indices, indices: Indices, data: NDArray[np.float64], both: bool) -> tuple[Starts, Indices]:
    n = starts.size - 1
    ends = np.zeros(n + 1, np.int64)
    for j in range(n):
        for p in range(starts[j], starts[j + 1]):
            i = indices[p]
            if data[p] != 0 and i != j:
                ends[j + 1] += 1
                if both:
                    ends[i + 1] += 1
    for j in range(n):
        ends[j + 1] += ends[j]
    found, at = np.empty(ends[n], np.int32), ends[:-1].copy()
    for j in range(n):
        for p in range(starts[j], starts[j + 1]):
            i = indices[p]
            if data[p] != 0 and i != j:
                found[at[j]] = i
                at[j] += 1
                if both:
                    found[at[i]] = j
                    at[i] += 1
    return ends, found
