"""Size of a Cholesky factor, known from the pattern of the matrix and its order, before anything is factorised."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.linalg.sparse.factor import FactorCost
from cmsreduce.multifrontal import compressed_graph, row_groups

__all__ = ["elimination_tree", "factor_cost"]


def factor_cost(A: sp.csc_array, order: NDArray[np.int64], bytes_per_entry: float = 8.0) -> FactorCost:
    """Entries and operations of the Cholesky factor of ``A[order][:, order]``, exact where nothing cancels.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; entries that are stored count, zeros too.
    order : (n,) int
        Row that is eliminated first, second, ...
    bytes_per_entry : float
        Memory that a solver takes for each entry of the factor.

    Returns
    -------
    FactorCost
        Operations: the sum of squares of the column counts.

    Notes
    -----
    Counted on the graph of groups of indistinguishable rows that are eliminated one after the other. Source: J.
    Gilbert, E. Ng, B. Peyton, "An efficient algorithm to compute row and column counts for sparse Cholesky
    factorization", SIAM J. Matrix Anal. Appl. 15 (1994) 1075-1091.
    """
    if A.shape[0] == 0:
        return FactorCost(0, 0.0, 0.0)
    graph, rows = compressed_graph(A, _runs(row_groups(A), order))
    below, w = _rows_below(graph, rows).astype(np.float64), rows.astype(np.float64)
    nnz = int(np.sum(w * below + w * (w + 1) / 2))
    flops = float(np.sum(w * below**2 + below * w * (w + 1) + w * (w + 1) * (2 * w + 1) / 6))
    return FactorCost(nnz, flops, bytes_per_entry * nnz)


def elimination_tree(graph: sp.csr_array) -> NDArray[np.int64]:
    """Parent of each vertex when vertices are eliminated in the order of their numbers.

    Parameters
    ----------
    graph : (g, g) csr array
        Symmetric, without loops.

    Returns
    -------
    parent : (g,) int64
        The next vertex in the same column structure; ``g`` for a root.

    Notes
    -----
    The tree says when parts grow together as vertices are added, and a spanning tree of least weights, the later end of
    an edge its weight, says the same with fewer edges. Source: J. Liu, "The role of elimination trees in sparse
    factorization", SIAM J. Matrix Anal. Appl. 11 (1990) 134-172.
    """
    n = graph.shape[0]
    upper = sp.coo_array(sp.triu(graph, 1))
    early, late = upper.coords
    # Weight zero would be no edge; the later end is 1 at least.
    spanning = sp.coo_array(csgraph.minimum_spanning_tree(sp.csr_array((late.astype(float), (early, late)), (n, n))))
    early, late = spanning.coords
    by_late = np.argsort(late, kind="stable")
    parent, above = [n] * n, list(range(n))
    for i, j in zip(early[by_late].tolist(), late[by_late].tolist(), strict=True):
        while above[i] != i:
            above[i], i = j, above[i]
        parent[i] = above[i] = j
    return np.array(parent, dtype=np.int64)


def _runs(group: NDArray[np.int64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number of each row's run, in the order of elimination: rows of one group with no other between."""
    sequence = group[order]
    run = np.empty_like(sequence)
    run[order] = np.cumsum(np.diff(sequence, prepend=sequence[0]) != 0)
    return run


def _rows_below(graph: sp.csr_array, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of the factor below each vertex's own, vertices in some order of elimination that has the same factor."""
    n = graph.shape[0]
    parent, place, size = _postordered(elimination_tree(graph))
    first = np.arange(n) - size + 1
    rows[place] = rows.copy()
    i, j = (place[end] for end in sp.coo_array(graph).coords)
    lower = i > j
    i, j = i[lower], j[lower]
    by_row = np.lexsort((j, i))
    i, j = i[by_row], j[by_row]
    # Row i of the factor is the subtree under i that its entries span. Its leaves: no entry further down.
    fresh = np.diff(i, prepend=-1) != 0
    leaf = fresh | (np.concatenate([[-1], j[:-1]]) < first[j])
    i, j, fresh = i[leaf], j[leaf], fresh[leaf]
    joins = np.flatnonzero(~fresh)
    # One for each leaf, less one where two branches meet and less one at i: sums over subtrees are 1 in row i, else 0.
    share = np.zeros(n + 1, dtype=np.int64)
    np.add.at(share, j, rows[i])
    np.subtract.at(share, i[fresh], rows[i[fresh]])
    np.subtract.at(share, _common_ancestors(parent, j[joins - 1], j[joins]), rows[i[joins]])
    total = np.concatenate([[0], np.cumsum(share[:n])])
    return np.asarray(total[1:] - total[first], dtype=np.int64)


def _postordered(tree: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Parents and subtree sizes in postorder, and each vertex's place in it: a subtree's vertices stand together."""
    n = tree.size
    parents = tree.tolist()
    size = [1] * n + [0]
    for child, parent in enumerate(parents):
        size[parent] += size[child]
    # Last place that is free in each subtree, whose own root takes the last of all.
    free, place = [0] * n + [n - 1], [0] * n
    for child in range(n - 1, -1, -1):
        parent = parents[child]
        place[child] = free[parent]
        free[child] = place[child] - 1
        free[parent] -= size[child]
    places = np.array(place, dtype=np.int64)
    parent_at, size_at = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    parent_at[places] = np.append(places, n)[tree]
    size_at[places] = size[:n]
    return parent_at, places, size_at


def _common_ancestors(parent: NDArray[np.int64], a: NDArray[np.int64], b: NDArray[np.int64]) -> NDArray[np.int64]:
    """Lowest common ancestors of vertices a < b in postorder: the first ancestor of a that is not before b."""
    n = parent.size
    steps = [np.append(parent, n)]
    while steps[-1].min() < n:
        steps.append(steps[-1][steps[-1]])
    for step in reversed(steps):
        a = np.where(step[a] < b, step[a], a)
    return steps[0][a]
