"""Size of a Cholesky factor, computed from the pattern and the order of the matrix before its factorisation."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.linalg.sparse.factor import FactorCost
from cmsreduce.multifrontal import compressed_graph, row_groups

__all__ = ["elimination_tree", "factor_cost"]


def factor_cost(A: sp.csc_array, order: NDArray[np.int64], bytes_per_entry: float = 8.0) -> FactorCost:
    """Entries and operations of the Cholesky factor of ``A[order][:, order]``, exact if no entry cancels.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; stored zeros count as entries.
    order : (n,) int
        Row that is eliminated first, second, ...
    bytes_per_entry : float
        Memory of a solver for each entry of the factor.

    Returns
    -------
    FactorCost
        Its operations are the sum of squares of the column counts.

    Notes
    -----
    The count uses the graph of groups of indistinguishable rows that are eliminated one after the other. Source: J.
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
    """Elimination tree of a graph whose vertices are eliminated in the order of their numbers.

    Parameters
    ----------
    graph : (g, g) csr array
        Symmetric, without loops.

    Returns
    -------
    parent : (g,) int64
        Parent of each vertex, the first row below the diagonal of its column in the factor; ``g`` for a root.

    Notes
    -----
    The tree records how parts of the graph join as vertices are added. The minimum spanning tree, with the later end of
    an edge as its weight, has the same joins and fewer edges. Source: J. Liu, "The role of elimination trees in sparse
    factorization", SIAM J. Matrix Anal. Appl. 11 (1990) 134-172.
    """
    n = graph.shape[0]
    upper = sp.coo_array(sp.triu(graph, 1))
    early, late = upper.coords
    # A weight of zero would be no edge; the later end is at least 1.
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
    """Number of the run of each row: rows of one group that are eliminated one after the other."""
    sequence = group[order]
    run = np.empty_like(sequence)
    run[order] = np.cumsum(np.diff(sequence, prepend=sequence[0]) != 0)
    return run


def _rows_below(graph: sp.csr_array, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows of the factor below the rows of each vertex; ``rows`` is put into postorder, which has the same factor."""
    n = graph.shape[0]
    parent, place, size = _postordered(elimination_tree(graph))
    first = np.arange(n) - size + 1
    rows[place] = rows.copy()
    i, j = (place[end] for end in sp.coo_array(graph).coords)
    lower = i > j
    i, j = i[lower], j[lower]
    by_row = np.lexsort((j, i))
    i, j = i[by_row], j[by_row]
    # Row i of the factor is the subtree under i that its entries span. A leaf has no entry below it.
    fresh = np.diff(i, prepend=-1) != 0
    leaf = fresh | (np.concatenate([[-1], j[:-1]]) < first[j])
    i, j, fresh = i[leaf], j[leaf], fresh[leaf]
    joins = np.flatnonzero(~fresh)
    # Add one at each leaf, subtract one where two branches meet and one at i. The sum over the subtree of a vertex is
    # then 1 if row i has an entry there, else 0.
    share = np.zeros(n + 1, dtype=np.int64)
    np.add.at(share, j, rows[i])
    np.subtract.at(share, i[fresh], rows[i[fresh]])
    np.subtract.at(share, _common_ancestors(parent, j[joins - 1], j[joins]), rows[i[joins]])
    total = np.concatenate([[0], np.cumsum(share[:n])])
    return np.asarray(total[1:] - total[first], dtype=np.int64)


def _postordered(tree: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Parents in postorder, the place of each vertex, and subtree sizes; the vertices of a subtree are consecutive."""
    n = tree.size
    parents = tree.tolist()
    size = [1] * n + [0]
    for child, parent in enumerate(parents):
        size[parent] += size[child]
    # Last free place in each subtree; its root takes the last place.
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
    """Lowest common ancestors of vertices a < b in postorder: the first ancestor of a at or after b."""
    n = parent.size
    steps = [np.append(parent, n)]
    while steps[-1].min() < n:
        steps.append(steps[-1][steps[-1]])
    for step in reversed(steps):
        a = np.where(step[a] < b, step[a], a)
    return steps[0][a]
