"""Fill-reducing order of a sparse symmetric matrix: nested dissection of its nodes instead of its rows."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["compressed_graph", "dissection_installed", "nested_dissection", "row_groups"]

# The order must be the same in every run.
_SEED = 1
# Consecutive rows that share so much of their columns are one vertex, so many at most: the dofs of a node whose
# cancelled couplings are not stored, as in aligned bricks. Neighbouring nodes share two thirds.
_ALIKE, _MOST = 0.7, 6
# A row that is coupled with more groups than these limits (the first is a multiple of the root of their number) would
# belong to every separator. It is ordered last, as minimum-degree codes do.
_DENSE, _DENSE_AT_LEAST = 10.0, 16
# Rows that are compared at a time.
_RUN = 4096


@cache
def dissection_installed() -> bool:
    """True if METIS is installed."""
    return importlib.util.find_spec("pymetis") is not None


def nested_dissection(A: sp.csc_array) -> NDArray[np.int64]:
    """Order the rows by nested dissection of the graph whose vertices are groups of rows with like columns.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; stored zeros count as entries.

    Returns
    -------
    order : (n,) int64
        ``A[order][:, order]`` has little fill; the rows of a group are consecutive. Uncoupled groups come first, rows
        that couple with very many groups last.

    Raises
    ------
    ImportError
        If `dissection_installed` is false.

    Notes
    -----
    Source: G. Karypis, V. Kumar, "A fast and high quality multilevel scheme for partitioning irregular graphs", SIAM J.
    Sci. Comput. 20 (1998) 359-392; compression: C. Ashcraft, "Compressed graphs and the minimum degree algorithm", SIAM
    J. Sci. Comput. 16 (1995) 1404-1411.
    """
    group = _vertices(A)
    graph, weight = compressed_graph(A, group)
    degree = np.diff(graph.indptr)
    dense = degree > max(_DENSE_AT_LEAST, _DENSE * np.sqrt(degree.size))
    sparse = np.flatnonzero(~dense)
    graph = graph[sparse][:, sparse] if dense.any() else graph
    coupled = np.diff(graph.indptr) > 0
    core = np.flatnonzero(coupled)
    graph = graph if coupled.all() else graph[core][:, core]
    sequence = np.concatenate(
        [sparse[~coupled], sparse[core[_dissect(graph, weight[sparse[core]])]], np.flatnonzero(dense)]
    )
    place = np.empty(sequence.size, dtype=np.int64)
    place[sequence] = np.arange(sequence.size)
    return np.argsort(place[group], kind="stable")


def row_groups(A: sp.csc_array) -> NDArray[np.int64]:
    """Group the rows that couple with the same rows, themselves included, as the dofs of a node do.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.

    Returns
    -------
    group : (n,) int64
        Number of the group of each row, from 0 in the order of the groups' first rows.

    Notes
    -----
    Rows with equal random sums over their columns are compared entry by entry: chance cannot merge two rows.
    """
    n = A.shape[0]
    if n == 0:
        return np.zeros(0, dtype=np.int64)
    pattern = _with_diagonal(A)
    columns, start = pattern.indices, pattern.indptr[:-1].astype(np.int64)
    length = np.diff(pattern.indptr)
    key = np.random.default_rng(_SEED).integers(0, 2**64, n, dtype=np.uint64)
    # Sums of unsigned integers wrap around. Each row has an entry, so that no sum takes that of the next row.
    total = np.concatenate([np.add.reduceat(key[columns[own]], at) for _, own, at in _runs_of(pattern)])
    _, first, number = np.unique(total, return_index=True, return_inverse=True)
    like = first[number]
    same_length = length == length[like]
    # A row of another length is compared with itself here and separated below.
    shift, same = np.where(same_length, start[like] - start, 0), np.empty(n, dtype=bool)
    for rows, own, at in _runs_of(pattern):
        others = np.arange(own.start, own.stop) + np.repeat(shift[rows], length[rows])
        same[rows] = np.logical_and.reduceat(columns[own] == columns[others], at)
    like = np.where(same & same_length, like, np.arange(n))
    # Groups are numbered by their first rows: neighbours stay near each other.
    return np.asarray(np.unique(like, return_inverse=True)[1], dtype=np.int64)


def _runs_of(pattern: sp.csc_array) -> Iterator[tuple[slice, slice, NDArray[np.integer[Any]]]]:
    """Rows in runs, so that temporary arrays stay short: the rows, their entries, and the starts of rows in these."""
    for first in range(0, pattern.shape[0], _RUN):
        starts = pattern.indptr[first : first + _RUN + 1]
        yield slice(first, first + starts.size - 1), slice(int(starts[0]), int(starts[-1])), starts[:-1] - starts[0]


def _vertices(A: sp.csc_array) -> NDArray[np.int64]:
    """Group of each row, numbered as by `row_groups`; a single row is joined with alike ones beside it."""
    group, pattern = row_groups(A), _with_diagonal(A)
    n, columns, start = group.size, pattern.indices, pattern.indptr
    if n < 2:
        return group
    cut = start[1]
    this = sp.csc_array((pattern.data[: start[-2]], columns[: start[-2]], start[:-1]), shape=(n, n - 1))
    following = sp.csc_array((pattern.data[cut:], columns[cut:], start[1:] - cut), shape=(n, n - 1))
    length, single = np.diff(start), np.bincount(group)[group] == 1
    shared = np.diff(sp.csc_array(this.multiply(following)).indptr)
    alike = shared >= _ALIKE * np.maximum(length[:-1], length[1:])
    # Groups of several rows stay apart.
    alike &= (group[:-1] == group[1:]) | single[:-1] | single[1:]
    rows = np.arange(n)
    run = np.maximum.accumulate(np.where(np.append(True, ~alike), rows, 0))
    first = rows - (rows - run) % _MOST
    return np.asarray(np.unique(group[first], return_inverse=True)[1], dtype=np.int64)


def _with_diagonal(A: sp.csc_array) -> sp.csc_array:
    """Pattern of the matrix with all diagonal entries and sorted indices."""
    n = A.shape[0]
    pattern = sp.csc_array((np.ones(A.nnz, dtype=bool), A.indices, A.indptr), shape=(n, n))
    if not A.has_canonical_format:
        # Sorting works in place and must not change the matrix.
        pattern = pattern.copy()
        pattern.sum_duplicates()
    return pattern if A.diagonal().all() else sp.csc_array(pattern + sp.eye_array(n, dtype=bool, format="csc"))


def compressed_graph(A: sp.csc_array, group: NDArray[np.int64]) -> tuple[sp.csr_array, NDArray[np.int64]]:
    """Graph of groups of rows, one vertex for each group.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    group : (n,) int64
        Group of each row.

    Returns
    -------
    graph : (g, g) csr array
        Couplings with the first row of a group, without loops; groups in the order of their numbers.
    rows : (g,) int64
        Number of rows in each group.
    """
    groups, first, weight = np.unique(group, return_index=True, return_counts=True)
    # Rows of a group couple with the same rows, or nearly so: one column of each is enough.
    part = sp.coo_array(sp.csc_array((np.ones(A.nnz, dtype=bool), A.indices, A.indptr), A.shape)[:, first])
    row, column = np.searchsorted(groups, group)[part.coords[0]], part.coords[1]
    keep = row != column
    row, column = row[keep], column[keep]
    ends = np.concatenate([row, column]), np.concatenate([column, row])
    graph = sp.csr_array((np.ones(2 * row.size, dtype=bool), ends), shape=(first.size, first.size))
    return graph, weight


def _dissect(graph: sp.csr_array, weight: NDArray[np.int64]) -> NDArray[np.int64]:
    if graph.shape[0] == 0:
        return np.zeros(0, dtype=np.int64)
    import pymetis

    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    order, _ = pymetis.nested_dissection(adjacency, vweights=weight, options=pymetis.Options(seed=_SEED))
    return np.asarray(order, dtype=np.int64)
