"""Supernodes of a Cholesky factor, their tree, and its subtrees for threads.

A supernode is a set of columns that are eliminated together, as one dense block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush, heapreplace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.elimination import column_counts, elimination_tree, postorder
from cmsreduce.multifrontal.loops import loop

__all__ = ["Supernodes", "shares", "supernodes"]

Ints = NDArray[np.int64]

# Number of splits of a subtree at its root in search of the best shares for threads; speed of a thread if all threads
# work on one dense block, relative to its speed on a subtree; smallest share of all operations of a subtree to split.
_SPLITS, _TOGETHER, _FINE = 200, 0.7, 1e-3
# Largest share of zeros in a supernode merged with its parent, by its number of columns: small blocks cost more than
# their zeros. For solids of 1e5 and 3e5 rows half and twice these shares take 0 to 15 % longer to factorise and to
# solve, and no merging takes a third longer.
_UP_TO, _ZEROS = (16, 64, 160), (1.0, 0.3, 0.1, 0.04)


@dataclass(frozen=True, eq=False)
class Supernodes:
    """Columns of a factor that have the same rows and are eliminated as one dense block.

    Parameters
    ----------
    order : (n,) int64
        Row of the matrix that is eliminated first, second, ...
    first : (s + 1,) int64
        Start of the columns of each supernode in this order.
    parent : (s,) int64
        Parent of each supernode: the one with its first row below; -1 for a root. Children come before their parents.
    rows : (r,) int32
        Rows below each supernode's columns, ascending, one supernode after the other.
    begin : (s + 1,) int64
        Start of the rows of each supernode.
    subtrees : (t + 1,) int64
        First supernode of each subtree that can be eliminated in parallel with the others, and first supernode above
        all subtrees.
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
        """Entries of the factor, with the zeros in merged supernodes."""
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
        Couplings of the rows, see `couplings`.
    order : (n,) int
        Row that is eliminated first, second, ...
    threads : int
        Number of threads that share the subtrees.

    Returns
    -------
    Supernodes
        Its order has the same fill as the given one, apart from the zeros in merged supernodes.

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
    first, parent, new = _merged(tree, count, np.array(_UP_TO), np.array(_ZEROS))
    columns, below = np.diff(first), count[new][first[1:] - 1] - 1
    sequence, subtrees = _divided(parent, operations(columns, below), threads)
    order = order[np.concatenate([new[first[k] : first[k + 1]] for k in sequence] or [new])]
    parent = _renumbered(parent, sequence)
    first, begin = (np.concatenate([[0], np.cumsum(part[sequence])]) for part in (columns, below))
    rows = _rows(starts, indices, order, _inverse(order), first, parent, begin)
    return Supernodes(order, first, parent, rows, begin, subtrees)


def operations(columns: Ints, below: Ints) -> NDArray[np.float64]:
    """Floating-point operations of the elimination of some columns with a number of rows below them."""
    c, r = columns.astype(np.float64), below.astype(np.float64)
    return c * r**2 + c**2 * r + c**3 / 3


def _divided(parent: Ints, cost: NDArray[np.float64], threads: int) -> tuple[Ints, Ints]:
    """Supernodes subtree by subtree, those above all subtrees last; and the start of each subtree, and their end."""
    subtree_cost, size = cost.copy(), np.ones(parent.size, dtype=np.int64)
    children: dict[int, list[int]] = {}
    for k, above in enumerate(parent.tolist()):
        children.setdefault(above, []).append(k)
        if above >= 0:
            subtree_cost[above] += subtree_cost[k]
            size[above] += size[k]
    # Split the heaviest subtree at its root again and again, and take the split with the shortest time.
    roots, above_all = [(-subtree_cost[k], k) for k in children.get(-1, [])], list[int]()
    heapify(roots)
    best, least = (sorted(k for _, k in roots), 0), np.inf
    whole, above_cost = float(cost.sum()), 0.0
    for _ in range(min(_SPLITS, parent.size)):
        together = above_cost / (_TOGETHER * threads)
        # No division into shares is quicker than equal ones, or than the heaviest subtree.
        if max((whole - above_cost) / threads, -roots[0][0] if roots else 0.0) + together < least:
            seconds = shares([-each for each, _ in roots], threads)[1] + together
            if seconds < least:
                best, least = (sorted(k for _, k in roots), len(above_all)), seconds
        if not roots or -roots[0][0] < _FINE * whole:
            break
        _, k = heappop(roots)
        above_all.append(k)
        above_cost += float(cost[k])
        for child in children.get(k, []):
            heappush(roots, (-subtree_cost[child], child))
    last, above = best[0], sorted(above_all[: best[1]])
    sequence = [np.arange(k - size[k] + 1, k + 1) for k in last]
    subtrees = np.concatenate([[0], np.cumsum(size[last])]).astype(np.int64)
    return np.concatenate([*sequence, np.array(above, dtype=np.int64)]).astype(np.int64), subtrees


def shares(cost: Sequence[float], threads: int) -> tuple[list[list[int]], float]:
    """Pieces of work of each thread, and the largest cost of a thread; the heaviest piece goes first, to the idlest."""
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
    """Parents in new numbers: vertex ``post[k]`` becomes vertex k."""
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
    """Rows below the columns of each supernode, ascending."""
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


@loop
def _merged(tree: Ints, count: Ints, up_to: Ints, zeros: NDArray[np.float64]) -> tuple[Ints, Ints, Ints]:
    """First columns and parents of merged supernodes, and the order in which their columns are consecutive."""
    begin, parent = _chains(tree, count)
    s = parent.size
    head, following = np.full(s, -1, np.int64), np.full(s, -1, np.int64)
    for k in range(s - 1, -1, -1):
        if parent[k] >= 0:
            following[k] = head[parent[k]]
            head[parent[k]] = k
    columns, below = begin[1:] - begin[:-1], count[begin[1:] - 1] - 1
    held = columns * below + columns * (columns + 1) / 2.0
    # Of merged pieces: the first one, and the successor of each.
    lead, link, gone = np.arange(s), np.full(s, -1, np.int64), np.zeros(s, np.bool_)
    for k in range(s):
        while True:
            best = _widest(k, head, following, gone, columns, below, held, up_to, zeros)
            if best == -1:
                break
            gone[best] = True
            columns[k] += columns[best]
            held[k] += held[best]
            # The child is the last of its own pieces; the pieces merged into k before come after it.
            link[best] = lead[k]
            lead[k] = lead[best]
            # The children of the merged child become children of k.
            grandchild = head[best]
            while grandchild != -1:
                after = following[grandchild]
                if not gone[grandchild]:
                    parent[grandchild] = k
                    following[grandchild] = head[k]
                    head[k] = grandchild
                grandchild = after
    first, parents, order = _numbered(begin, parent, lead, link, gone)
    return first, parents, order


@loop
def _chains(tree: Ints, count: Ints) -> tuple[Ints, Ints]:
    """Consecutive columns with the same rows: first column of each supernode (s + 1,), and its parent (s,)."""
    n = tree.size
    begin, owner = np.empty(n + 1, np.int64), np.empty(n, np.int64)
    s = 0
    for j in range(n):
        if j == 0 or tree[j - 1] != j or count[j - 1] != count[j] + 1:
            begin[s] = j
            s += 1
        owner[j] = s - 1
    begin[s] = n
    parent = np.full(s, -1, np.int64)
    for k in range(s):
        above = tree[begin[k + 1] - 1]
        if above >= 0:
            parent[k] = owner[above]
    return begin[: s + 1].copy(), parent


@loop
def _widest(
    k: int,
    head: Ints,
    following: Ints,
    gone: NDArray[np.bool_],
    columns: Ints,
    below: Ints,
    held: NDArray[np.float64],
    up_to: Ints,
    zeros: NDArray[np.float64],
) -> int:
    """Child to merge with supernode k: among the allowed ones that with most rows, so fewest zeros; -1 if none is."""
    best, best_rows = -1, -1
    child = head[k]
    while child != -1:
        if not gone[child] and columns[child] + below[child] > best_rows:
            c = columns[k] + columns[child]
            size = c * below[k] + c * (c + 1) / 2.0
            if 1.0 - (held[k] + held[child]) / size <= zeros[np.searchsorted(up_to, c)]:
                best, best_rows = child, columns[child] + below[child]
        child = following[child]
    return best


@loop
def _numbered(begin: Ints, parent: Ints, lead: Ints, link: Ints, gone: NDArray[np.bool_]) -> tuple[Ints, Ints, Ints]:
    """First columns and parents of the remaining supernodes, children first, and the order of columns."""
    kept = np.flatnonzero(~gone)
    number = np.full(gone.size, -1, np.int64)
    number[kept] = np.arange(kept.size)
    above = np.full(kept.size, -1, np.int64)
    for new in range(kept.size):
        if parent[kept[new]] >= 0:
            above[new] = number[parent[kept[new]]]
    post = postorder(above)
    final = np.empty(kept.size, np.int64)
    final[post] = np.arange(kept.size)
    first, parents = np.zeros(kept.size + 1, np.int64), np.full(kept.size, -1, np.int64)
    order, done = np.empty(begin[-1], np.int64), 0
    for new in range(kept.size):
        if above[post[new]] >= 0:
            parents[new] = final[above[post[new]]]
        piece = lead[kept[post[new]]]
        while piece != -1:
            for j in range(begin[piece], begin[piece + 1]):
                order[done] = j
                done += 1
            piece = link[piece]
        first[new + 1] = done
    return first, parents, order
