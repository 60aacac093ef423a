"""Dense blocks of a multifrontal Cholesky factorisation: where they lie, how they are assembled and eliminated."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.blas import factorise_block, solve_block, subtract_product, update
from cmsreduce.multifrontal.loops import loop

__all__ = ["PANEL", "Blocks", "Given", "depth_parity", "eliminate", "place_panels", "stack_size"]

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]

PANEL = 256
"""Columns of a panel at most. A panel has no rows above its first column, so that little but the lower triangle is
stored."""

# Columns of a panel that are eliminated at a time; of 16, 32, 64 and 256, 64 take least: 6 % less than the whole panel.
_STRIP = 64


class Blocks(NamedTuple):
    """Supernodes of a factor, and their entries.

    Parameters
    ----------
    first : (s + 1,) int64
        Where each supernode's columns begin.
    rows : (r,) int32
        Rows below each supernode's columns, ascending, one supernode after the other.
    begin : (s + 1,) int64
        Where each supernode's rows begin.
    panels : (s + 1,) int64
        Where the panels of each supernode are numbered from.
    entries : (p + 1,) int64
        Where the entries of each panel begin, which lie by columns.
    values : float64 or float32
        Entries of all panels.
    """

    first: Ints
    rows: Rows
    begin: Ints
    panels: Ints
    entries: Ints
    values: NDArray[Any]


class Given(NamedTuple):
    """A matrix to be factorised, and the tree that says in which order.

    Parameters
    ----------
    starts, indices, data
        Compressed columns of the matrix, both triangles.
    scale : (n,) float64
        Factors of its rows and columns.
    order, place : (n,) int64
        Row that is eliminated first, second, ..., and when each is.
    members, children : (s + 1,), (c,) int64
        Where the children of each supernode begin, and all children.
    parity : (s,) int64
        Whether a supernode lies an even or an odd number of steps below its root.
    """

    starts: Rows
    indices: Rows
    data: NDArray[np.float64]
    scale: NDArray[np.float64]
    order: Ints
    place: Ints
    members: Ints
    children: Ints
    parity: Ints


@loop
def place_panels(first: Ints, begin: Ints) -> tuple[Ints, Ints]:
    """Where the panels of each supernode are numbered from (s + 1,), and where each panel's entries begin (p + 1,)."""
    s = first.size - 1
    panels = np.zeros(s + 1, np.int64)
    for k in range(s):
        panels[k + 1] = panels[k] + (first[k + 1] - first[k] + PANEL - 1) // PANEL
    entries = np.zeros(panels[s] + 1, np.int64)
    for k in range(s):
        c = first[k + 1] - first[k]
        front = c + begin[k + 1] - begin[k]
        for j, p in enumerate(range(panels[k], panels[k + 1])):
            a = j * PANEL
            entries[p + 1] = entries[p] + (front - a) * (min(a + PANEL, c) - a)
    return panels, entries


@loop
def depth_parity(parent: Ints) -> Ints:
    """0 or 1: whether each supernode lies an even or an odd number of steps below its root."""
    parity = np.zeros(parent.size, np.int64)
    for k in range(parent.size - 1, -1, -1):
        if parent[k] >= 0:
            parity[k] = 1 - parity[parent[k]]
    return parity


@loop
def stack_size(low: int, high: int, begin: Ints, members: Ints, children: Ints, parity: Ints) -> int:
    """Entries of updates that are held at most while supernodes are eliminated, see `eliminate`.

    Those of children before ``low`` are brought when they are needed.
    """
    tops, most = np.zeros(2, np.int64), 0
    for k in range(low, high):
        side, freed = parity[k], 0
        for child in children[members[k] : members[k + 1]]:
            held = (begin[child + 1] - begin[child]) ** 2
            freed += held
            if child < low:
                tops[1 - side] += held
        tops[side] += (begin[k + 1] - begin[k]) ** 2
        most = max(most, tops[0] + tops[1])
        tops[1 - side] -= freed
    return most


@loop
def eliminate(
    low: int,
    high: int,
    given: Given,
    blocks: Blocks,
    places: Ints,
    updates: NDArray[Any],
    tops: Ints,
    where: Rows,
    table: Ints,
) -> int:
    """Eliminate supernodes, children before parents; 0, or the number of the pivot that is not positive.

    What a supernode leaves for its parent lies in one of two stacks, which grow from both ends of ``updates``, what its
    children left in the other: it needs not be moved to where theirs was. ``places`` (s,) tells where each one's is,
    ``tops`` (2,) how much lies in each stack; ``where`` (n,) is room to work in.
    """
    sizes = np.empty(8, np.int32)
    for k in range(low, high):
        children = given.children[given.members[k] : given.members[k + 1]]
        left, side = (blocks.begin[k + 1] - blocks.begin[k]) ** 2, given.parity[k]
        places[k] = tops[0] if side == 0 else updates.size - tops[1] - left
        _assemble(k, given, blocks, children, places, updates, where)
        failed = _eliminate_columns(k, blocks, table, sizes)
        if failed:
            return int(failed)
        _pass_on(k, blocks, children, places, updates, where, table, sizes)
        tops[side] += left
        for child in children:
            tops[1 - side] -= (blocks.begin[child + 1] - blocks.begin[child]) ** 2
    return 0


@loop
def _assemble(
    k: int, given: Given, blocks: Blocks, children: Ints, places: Ints, updates: NDArray[Any], where: Rows
) -> None:
    """Columns of supernode k: those of the matrix, and what its children left for them."""
    start, c = blocks.first[k], blocks.first[k + 1] - blocks.first[k]
    below, panel = blocks.rows[blocks.begin[k] : blocks.begin[k + 1]], blocks.panels[k]
    front, values = c + below.size, blocks.values
    for j in range(c):
        where[start + j] = j
    for j in range(below.size):
        where[below[j]] = c + j
    values[blocks.entries[panel] : blocks.entries[blocks.panels[k + 1]]] = 0
    for j in range(c):
        at = _column(blocks, panel, front, j)
        column = given.order[start + j]
        for p in range(given.starts[column], given.starts[column + 1]):
            row = given.indices[p]
            i = given.place[row]
            if i >= start + j and given.data[p] != 0:
                values[at + where[i]] += given.data[p] * given.scale[column] * given.scale[row]
    for child in children:
        theirs = blocks.rows[blocks.begin[child] : blocks.begin[child + 1]]
        to, ends = _runs(theirs, where)
        for q in range(to.size):
            if to[q] >= c:
                break
            _add(values, _column(blocks, panel, front, to[q]), updates, places[child] + q * to.size, q, to, ends)


@loop
def _column(blocks: Blocks, panel: int, front: int, j: int) -> int:
    """Where row 0 of column j of a front would lie, whose first panel has that number."""
    a = j // PANEL * PANEL
    return int(blocks.entries[panel + j // PANEL] + (j - a) * (front - a) - a)


@loop
def _eliminate_columns(k: int, blocks: Blocks, table: Ints, sizes: Rows) -> int:
    """Cholesky factor of the columns of supernode k, panel by panel."""
    c = blocks.first[k + 1] - blocks.first[k]
    front = c + blocks.begin[k + 1] - blocks.begin[k]
    step, base = blocks.values.itemsize, blocks.values.ctypes.data
    low, high = blocks.panels[k], blocks.panels[k + 1]
    for panel in range(low, high):
        a = (panel - low) * PANEL
        w, height = min(PANEL, c - a), front - a
        here = base + blocks.entries[panel] * step
        failed = _eliminate_panel(w, height, here, step, table, sizes)
        if failed:
            return int(blocks.first[k] + a + failed)
        for later in range(panel + 1, high):
            b = (later - low) * PANEL
            source, to = here + (b - a) * step, base + blocks.entries[later] * step
            shape = (front - b, min(PANEL, c - b), w)
            subtract_product(table, sizes, shape, (source, height), (source, height), (to, front - b))
    return 0


@loop
def _eliminate_panel(w: int, height: int, here: int, step: int, table: Ints, sizes: Rows) -> int:
    """Cholesky factor of a panel that lies by columns from ``here`` on: 0, or the number of the pivot that failed.

    A few columns at a time, after all that the columns before them change: products are fast, triangular solves not.
    """
    for a in range(0, w, _STRIP):
        columns, rows = min(_STRIP, w - a), height - a
        block = here + (a * height + a) * step
        if a:
            before = here + a * step
            subtract_product(table, sizes, (rows, columns, a), (before, height), (before, height), (block, height))
        failed = factorise_block(table, sizes, columns, (block, height))
        if failed:
            return int(a + failed)
        if rows > columns:
            below = block + columns * step
            solve_block(table, sizes, (rows - columns, columns), (block, height), (below, height))
    return 0


@loop
def _pass_on(
    k: int,
    blocks: Blocks,
    children: Ints,
    places: Ints,
    updates: NDArray[Any],
    where: Rows,
    table: Ints,
    sizes: Rows,
) -> None:
    """What supernode k leaves for its parent: minus the product of its rows, and the rest of what its children left."""
    c, r = blocks.first[k + 1] - blocks.first[k], blocks.begin[k + 1] - blocks.begin[k]
    if not r:
        return
    step, base = updates.itemsize, blocks.values.ctypes.data
    rest = updates.ctypes.data + places[k] * step
    for panel in range(blocks.panels[k], blocks.panels[k + 1]):
        a = (panel - blocks.panels[k]) * PANEL
        source = base + (blocks.entries[panel] + c - a) * step
        update(table, sizes, (r, min(PANEL, c - a)), (source, c + r - a), (rest, r), panel == blocks.panels[k])
    for child in children:
        to, ends = _runs(blocks.rows[blocks.begin[child] : blocks.begin[child + 1]], where)
        for q in range(to.size):
            if to[q] >= c:
                _add(updates, places[k] + (to[q] - c) * r - c, updates, places[child] + q * to.size, q, to, ends)


@loop
def _runs(theirs: Rows, where: Rows) -> tuple[Rows, Rows]:
    """Where a child's rows are in the front, and for each the first one after it that does not follow on."""
    at, ends = np.empty(theirs.size, np.int32), np.empty(theirs.size, np.int32)
    for i in range(theirs.size):
        at[i] = where[theirs[i]]
    for i in range(theirs.size - 1, -1, -1):
        joined = i + 1 < theirs.size and at[i + 1] == at[i] + 1
        ends[i] = ends[i + 1] if joined else i + 1
    return at, ends


@loop
def _add(into: NDArray[Any], at: int, updates: NDArray[Any], source: int, q: int, to: Rows, ends: Rows) -> None:
    """Add column q of an update, from its diagonal on, to a column that lies from ``at`` on."""
    i = q
    while i < to.size:
        here, part = at + to[i], source + i
        for d in range(ends[i] - i):
            into[here + d] += updates[part + d]
        i = ends[i]
