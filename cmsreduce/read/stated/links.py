"""Pairs of nodes that bars and springs alone couple: their stiffness shows whatever else is at the nodes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

__all__ = ["sole_links"]

Indices = NDArray[np.int64]


def sole_links(count: int, pairs: Indices, others: Sequence[Indices], tied: Sequence[Indices]) -> Indices:
    """Pairs of nodes that no other element couples.

    Parameters
    ----------
    count : int
        Number of nodes.
    pairs : (p, 2) int64
        Nodes of bars and springs with a known stiffness.
    others : sequence of (e, k) int64
        Nodes of all other elements.
    tied : sequence of (k,) int64
        Nodes of each constraint. Elements at any of them may couple all of them.

    Returns
    -------
    (q, 2) int64
        In ascending order, the smaller first.

    Examples
    --------
    >>> brick, spring = np.array([[0, 1, 2]]), np.array([[1, 2], [3, 2], [4, 0]])
    >>> sole_links(5, spring, [brick], []).tolist(), sole_links(5, spring, [brick], [np.array([1, 3])]).tolist()
    ([[0, 4], [2, 3]], [[0, 4]])
    """
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    if not len(pairs):
        return pairs
    group = np.arange(count)
    if tied:
        first = np.concatenate([np.full(each.size, each[0]) for each in tied])
        joined = sp.coo_array((np.ones(first.size), (first, np.concatenate(tied))), shape=(count, count))
        group = connected_components(joined, directed=False)[1].astype(np.int64)
    ends = np.sort(group[pairs], axis=1)
    inside, of = np.unique(ends, return_inverse=True)
    of = of.reshape(-1, 2)
    # Two pairs of nodes between the same groups are seen together.
    _, at, times = np.unique(of[:, 0] * inside.size + of[:, 1], return_inverse=True, return_counts=True)
    sole = (of[:, 0] != of[:, 1]) & (times[at] == 1)
    place = np.full(int(group.max()) + 1, -1)
    place[inside] = np.arange(inside.size)
    for nodes in others:
        found = place[group[nodes]]
        element, slot = np.nonzero(found >= 0)
        touched = sp.csr_array(
            (np.ones(element.size), (element, found[element, slot])), shape=(len(nodes), inside.size)
        )
        coupled = sp.csr_array(touched.T @ touched)
        sole &= np.asarray(coupled[of[:, 0], of[:, 1]]).ravel() == 0
    return np.asarray(pairs[sole])
