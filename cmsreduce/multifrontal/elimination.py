"""Elimination tree of a sparse symmetric matrix, and the number of entries in each column of its Cholesky factor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.multifrontal.loops import loop

__all__ = [
    "Pattern",
    "column_counts",
    "couplings",
    "elimination_tree",
    "pattern_of",
    "postorder",
    "short_indices",
]

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]


@loop
def elimination_tree(starts: Ints, indices: Rows, order: Ints, place: Ints) -> Ints:
    """Elimination tree: the parent of each column, in the order of elimination; -1 for a root.

    Source: J. Liu, "The role of elimination trees in sparse factorization", SIAM J. Matrix Anal. Appl. 11 (1990)
    134-172.
    """
    n = order.size
    parent, ancestor = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    for k in range(n):
        column = order[k]
        for p in range(starts[column], starts[column + 1]):
            i = place[indices[p]]
            while i != -1 and i < k:
                above = ancestor[i]
                ancestor[i] = k
                if above == -1:
                    parent[i] = k
                i = above
    return parent


@loop
def postorder(tree: Ints) -> Ints:
    """Vertices of a forest in postorder: each vertex comes right after its subtree."""
    n = tree.size
    head, following = np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    post, stack = np.empty(n, np.int64), np.empty(n, np.int64)
    for j in range(n - 1, -1, -1):
        if tree[j] >= 0:
            following[j] = head[tree[j]]
            head[tree[j]] = j
    done = 0
    for root in range(n):
        if tree[root] >= 0:
            continue
        top = 0
        stack[0] = root
        while top >= 0:
            j = stack[top]
            child = head[j]
            if child == -1:
                post[done] = j
                done += 1
                top -= 1
            else:
                head[j] = following[child]
                top += 1
                stack[top] = child
    return post


@loop
def column_counts(starts: Ints, indices: Rows, order: Ints, place: Ints, tree: Ints) -> Ints:
    """Number of entries in each column of the factor, with the diagonal; columns in postorder.

    Source: J. Gilbert, E. Ng, B. Peyton, SIAM J. Matrix Anal. Appl. 15 (1994) 1075-1091.
    """
    n = order.size
    first, furthest, last = np.full(n, -1, np.int64), np.full(n, -1, np.int64), np.full(n, -1, np.int64)
    ancestor, count = np.arange(n), np.zeros(n, np.int64)
    for k in range(n):
        count[k] = 1 if first[k] == -1 else 0
        j = k
        while j != -1 and first[j] == -1:
            first[j] = k
            j = tree[j]
    for j in range(n):
        if tree[j] != -1:
            count[tree[j]] -= 1
        column = order[j]
        for p in range(starts[column], starts[column + 1]):
            i = place[indices[p]]
            if i <= j or first[j] <= furthest[i]:
                continue
            # Column j is a leaf of the subtree that row i's entries span.
            furthest[i] = first[j]
            before = last[i]
            last[i] = j
            count[j] += 1
            if before == -1:
                continue
            meet = before
            while meet != ancestor[meet]:
                meet = ancestor[meet]
            while before != meet:
                above = ancestor[before]
                ancestor[before] = meet
                before = above
            count[meet] -= 1
        if tree[j] != -1:
            ancestor[j] = tree[j]
    for j in range(n):
        if tree[j] != -1:
            count[tree[j]] += count[j]
    return count


class Pattern(NamedTuple):
    """Both triangles of a matrix compared.

    Parameters
    ----------
    mirrored : bool
        True if each nonzero entry has its mirror image.
    full : bool
        True if no zero is stored.
    number : int
        Hash of the places of the nonzero entries below the diagonal, 64 bits.
    """

    mirrored: bool
    full: bool
    number: int


def short_indices(A: sp.csc_array) -> sp.csc_array:
    """Matrix with indices of 32 bits, the ones that loops are compiled for beforehand.

    Parameters
    ----------
    A : (n, n) csc array

    Returns
    -------
    (n, n) csc array
        A itself if its indices are short, or if it has too many entries for them; else it shares the values of A.
    """
    if A.indices.dtype == np.int32 or A.nnz > np.iinfo(np.int32).max:
        return A
    return sp.csc_array((A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32)), shape=A.shape)


def pattern_of(A: sp.csc_array) -> Pattern:
    """Compare both triangles of a matrix (n, n)."""
    A = short_indices(A)
    mirrored, full, number = _compared(A.indptr, A.indices, A.data)
    return Pattern(mirrored, full, int(number))


def couplings(A: sp.csc_array, pattern: Pattern | None = None) -> tuple[Ints, Rows]:
    """Rows that each row of a symmetric matrix is coupled with, in compressed form.

    Parameters
    ----------
    A : (n, n) csc array
        An entry in one triangle alone couples too: rounding leaves such entries.
    pattern : Pattern, optional
        Result of `pattern_of`, if known.

    Returns
    -------
    starts : (n + 1,) int64
    indices : int32
        A row may occur twice, and may be among its own. The pattern of the matrix itself, without a copy, where that
        tells it all.
    """
    A = short_indices(A)
    mirrored, full, _ = pattern or pattern_of(A)
    if mirrored and full:
        return A.indptr.astype(np.int64), A.indices.astype(np.int32, copy=False)
    starts, indices = _couplings(A.indptr, A.indices, A.data, not mirrored)
    return starts, indices


@loop
def _compared(starts: Rows, indices: Rows, data: NDArray[np.float64]) -> tuple[bool, bool, np.uint64]:
    """Compare a hash sum of both triangles: whether each nonzero entry has its mirror image; and find stored zeros.

    The hash of a pair is a product of two, so that a column takes one product.
    """
    n = starts.size - 1
    high, low = np.empty(n, np.uint64), np.empty(n, np.uint64)
    for j in range(n):
        high[j], low[j] = _hash(j, 0), _hash(j, 1)
    lower, upper, full = np.uint64(0), np.uint64(0), True
    for j in range(n):
        below, above = np.uint64(0), np.uint64(0)
        for p in range(starts[j], starts[j + 1]):
            i = indices[p]
            if data[p] == 0:
                full = False
            elif i > j:
                below += high[i]
            elif i < j:
                above += low[i]
        lower += below * low[j]
        upper += above * high[j]
    return bool(lower == upper), full, lower


@loop
def _hash(i: int, j: int) -> np.uint64:
    """Hash of an ordered pair (the finalizer of splitmix64)."""
    x = (np.uint64(i) << np.uint64(32)) ^ np.uint64(j)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@loop
def _couplings(starts: Rows, indices: Rows, data: NDArray[np.float64], both: bool) -> tuple[Ints, Rows]:
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
