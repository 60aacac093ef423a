"""Amalgamation: small supernodes join their parents, as long as few zeros join the factor with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.elimination import postorder
from cmsreduce.linalg.loops import loop

__all__ = ["UP_TO", "ZEROS", "merged"]

Ints = NDArray[np.int64]

UP_TO = (16, 64, 160)
ZEROS = (1.0, 0.3, 0.1, 0.04)
"""Share of zeros that may join the factor when a supernode is merged with its parent, by the columns they then have:
small blocks cost more to handle than their zeros. Of solids of 1e5 and 3e5 rows half and twice these shares took 0 to
15 % longer to factorise and to solve with, none at all a third."""


@loop
def merged(tree: Ints, count: Ints, up_to: Ints, zeros: NDArray[np.float64]) -> tuple[Ints, Ints, Ints]:
    """First columns and parents of merged supernodes, and the order of columns that they stand together in."""
    begin, parent = _chains(tree, count)
    s = parent.size
    head, following = np.full(s, -1, np.int64), np.full(s, -1, np.int64)
    for k in range(s - 1, -1, -1):
        if parent[k] >= 0:
            following[k] = head[parent[k]]
            head[parent[k]] = k
    columns, below = begin[1:] - begin[:-1], count[begin[1:] - 1] - 1
    held = columns * below + columns * (columns + 1) / 2.0
    # Of what became one: the piece that comes first, and which follows each.
    lead, link, gone = np.arange(s), np.full(s, -1, np.int64), np.zeros(s, np.bool_)
    for k in range(s):
        while True:
            best = _widest(k, head, following, gone, columns, below, held, up_to, zeros)
            if best == -1:
                break
            gone[best] = True
            columns[k] += columns[best]
            held[k] += held[best]
            # The child was the last of its own pieces, and what this one has taken in comes after.
            link[best] = lead[k]
            lead[k] = lead[best]
            # Its children are this one's now.
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
    """Columns with the same rows, one after the other: where each supernode begins (s + 1,), and its parent (s,)."""
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
    """The child of supernode k that may join it and brings the fewest zeros, the one of most rows; -1 if none may."""
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
    """First columns and parents of the supernodes that are left, children first, and the order of columns."""
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
