"""Which columns of a Cholesky factor are eliminated together, in dense blocks: its supernodes and their tree."""

from __future__ import annotations

from collections.abc import Sequence
from heapq import heapify, heappop, heappush, heapreplace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.amalgamation import UP_TO, ZEROS, merged
from cmsreduce.linalg.elimination import column_counts, elimination_tree, postorder
from cmsreduce.linalg.loops import loop

__all__ = ["Supernodes", "shares", "supernodes"]

Ints = NDArray[np.int64]

# Times that a subtree is split at its root to find what threads share best, and what of their speed remains to those
# that work on one dense block together. A subtree of a smaller share of all operations is not worth it.
_SPLITS, _TOGETHER, _FINE = 200, 0.7, 1e-3


class Supernodes(NamedTuple):
    """Columns of a factor that share their rows, and are eliminated as one dense block.

    Parameters
    ----------
    order : (n,) int64
        Row of the matrix that is eliminated first, second, ...
    first : (s + 1,) int64
        Where each supernode's columns begin in that order.
    parent : (s,) int64
        The supernode that a supernode's first row below lies in; -1 for a root. Children come before their parents.
    rows : (r,) int32
        Rows below each supernode's columns, ascending, one supernode after the other.
    begin : (s + 1,) int64
        Where each supernode's rows begin.
    subtrees : (t + 1,) int64
        Where the supernodes of each subtree begin that can be eliminated beside the others, and where those begin that
        follow after all of them.
    """

    order: Ints
    first: Ints
    parent: Ints
    rows: NDArray[np.int32]
    begin: Ints
    subtrees: Ints

    @property
    def above(self) -> range:
        """Supernodes above all subtrees."""
        return range(int(self.subtrees[-1]), self.parent.size)

    def subtree(self, number: int) -> range:
        """Supernodes of a subtree."""
        return range(int(self.subtrees[number]), int(self.subtrees[number + 1]))

    @property
    def nnz(self) -> int:
        """Entries of the factor, with the zeros that merged supernodes take in."""
        columns = np.diff(self.first)
        return int((columns * np.diff(self.begin) + columns * (columns + 1) // 2).sum())

    @property
    def operations(self) -> NDArray[np.float64]:
        """Floating-point operations of each supernode's elimination (s,)."""
        return operations(np.diff(self.first), np.diff(self.begin))


def supernodes(starts: Ints, indices: NDArray[np.int32], order: Ints, threads: int = 1) -> Supernodes:
    """Supernodes of the Cholesky factor of a symmetric matrix in a fill-reducing order.

    Parameters
    ----------
    starts, indices : int64, int32
        Rows that each row is coupled with, see `couplings`.
    order : (n,) int
        Row that is eliminated first, second, ...
    threads : int
        Threads that subtrees are divided for.

    Returns
    -------
    Supernodes
        The order is another one of the same fill, but for the zeros that merged supernodes take in.

    Notes
    -----
    Source: C. Ashcraft, R. Grimes, "The influence of relaxed supernode partitions on the multifrontal method", ACM
    Trans. Math. Softw. 15 (1989) 291-309.
    """
    order = np.asarray(order, dtype=np.int64)
    place = _inverse(order)
    tree = elimination_tree(starts, indices, order, place)
    post = postorder(tree)
    order, tree = order[post], _renumbered(tree, post)
    place = _inverse(order)
    count = column_counts(starts, indices, order, place, tree)
    first, parent, new = merged(tree, count, np.array(UP_TO), np.array(ZEROS))
    columns, below = np.diff(first), count[new][first[1:] - 1] - 1
    sequence, subtrees = _divided(parent, operations(columns, below), threads)
    order = order[np.concatenate([new[first[k] : first[k + 1]] for k in sequence] or [new])]
    parent = _renumbered(parent, sequence)
    first, begin = (np.concatenate([[0], np.cumsum(part[sequence])]) for part in (columns, below))
    rows = _rows(starts, indices, order, _inverse(order), first, parent, begin)
    return Supernodes(order, first, parent, rows, begin, subtrees)


def operations(columns: Ints, below: Ints) -> NDArray[np.float64]:
    """Floating-point operations that eliminate columns with so many rows below them."""
    c, r = columns.astype(np.float64), below.astype(np.float64)
    return c * r**2 + c**2 * r + c**3 / 3


def _divided(parent: Ints, cost: NDArray[np.float64], threads: int) -> tuple[Ints, Ints]:
    """Supernodes subtree by subtree, those above all subtrees last, and where each subtree begins and the last ends."""
    whole, size = cost.copy(), np.ones(parent.size, dtype=np.int64)
    children: dict[int, list[int]] = {}
    for k, above in enumerate(parent.tolist()):
        children.setdefault(above, []).append(k)
        if above >= 0:
            whole[above] += whole[k]
            size[above] += size[k]
    # One after the other, the heaviest subtree loses its root; threads share what is left the best way that was seen.
    roots, apart = [(-whole[k], k) for k in children.get(-1, [])], list[int]()
    heapify(roots)
    best, least = (sorted(k for _, k in roots), 0), np.inf
    for _ in range(min(_SPLITS, parent.size)):
        seconds = shares([-each for each, _ in roots], threads)[1] + cost[apart].sum() / (_TOGETHER * threads)
        if seconds < least:
            best, least = (sorted(k for _, k in roots), len(apart)), seconds
        if not roots or -roots[0][0] < _FINE * cost.sum():
            break
        _, k = heappop(roots)
        apart.append(k)
        for child in children.get(k, []):
            heappush(roots, (-whole[child], child))
    last, above = best[0], sorted(apart[: best[1]])
    sequence = [np.arange(k - size[k] + 1, k + 1) for k in last]
    subtrees = np.concatenate([[0], np.cumsum(size[last])]).astype(np.int64)
    return np.concatenate([*sequence, np.array(above, dtype=np.int64)]).astype(np.int64), subtrees


def shares(cost: Sequence[float], threads: int) -> tuple[list[list[int]], float]:
    """Share out work among threads, the heaviest piece first to the one that has the least; the most that one has."""
    found: list[list[int]] = [[] for _ in range(threads)]
    load = [(0.0, t) for t in range(threads)]
    for piece in sorted(range(len(cost)), key=lambda piece: -cost[piece]):
        done, t = load[0]
        found[t].append(piece)
        heapreplace(load, (done + cost[piece], t))
    return found, max(done for done, _ in load)


def _inverse(order: Ints) -> Ints:
    place = np.empty_like(order)
    place[order] = np.arange(order.size)
    return place


def _renumbered(tree: Ints, post: Ints) -> Ints:
    """Parents by new numbers: the vertex at place k was ``post[k]``."""
    return np.append(_inverse(post), -1)[tree[post]]


@loop
def _rows(
    starts: Ints,
    indices: NDArray[np.int32],
    order: Ints,
    place: Ints,
    first: Ints,
    parent: Ints,
    begin: Ints,
) -> NDArray[np.int32]:
    """Rows below each supernode, ascending."""
    s = parent.size
    rows, seen = np.empty(begin[s], np.int32), np.full(order.size, -1, np.int64)
    head, following = np.full(s, -1, np.int64), np.full(s, -1, np.int64)
    for k in range(s):
        at, end = begin[k], first[k + 1]
        for j in range(first[k], end):
            column = order[j]
            for p in range(starts[column], starts[column + 1]):
                i = place[indices[p]]
                if i >= end and seen[i] != k:
                    seen[i] = k
                    rows[at] = i
                    at += 1
        child = head[k]
        while child != -1:
            for p in range(begin[child], begin[child + 1]):
                i = rows[p]
                if i >= end and seen[i] != k:
                    seen[i] = k
                    rows[at] = i
                    at += 1
            child = following[child]
        rows[begin[k] : at] = np.sort(rows[begin[k] : at])
        if parent[k] >= 0:
            following[k] = head[parent[k]]
            head[parent[k]] = k
    return rows
