"""Dense blocks of a multifrontal factorisation: storage, assembly and elimination.

The front of a supernode has its columns and the rows below them. The update is the part of the front that remains
after the elimination; it is added to the front of the parent.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.loops import loop
from cmsreduce.multifrontal.panels import PANEL, eliminate_panel, subtract_columns, update_rest

__all__ = ["Blocks", "Given", "depth_parity", "eliminate", "place_panels", "stack_size"]

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]


class Blocks(NamedTuple):
    """Supernodes of a factor L S L^T, and the entries of L.

    Parameters
    ----------
    first : (s + 1,) int64
        Start of the columns of each supernode.
    rows : (r,) int32
        Rows below each supernode's columns, ascending, one supernode after the other.
    begin : (s + 1,) int64
        Start of the rows of each supernode.
    panels : (s + 1,) int64
        Number of the first panel of each supernode.
    entries : (p + 1,) int64
        Start of the entries of each panel, which are stored by columns.
    values : float64 or float32
        Entries of all panels; of the panels of one supernode at a time if they are not kept.
    signs : (n,) int8
        Sign in S of each column in a diagonalised block; 0 for other columns, whose sign is positive.
    """

    first: Ints
    rows: Rows
    begin: Ints
    panels: Ints
    entries: Ints
    values: NDArray[Any]
    signs: NDArray[np.int8]


class Given(NamedTuple):
    """A matrix to factorise, its order, and its tree of supernodes.

    Parameters
    ----------
    starts, indices, data
        Compressed columns of the matrix, both triangles.
    scale : (n,) float64
        Scale of its rows and columns.
    order, place : (n,) int64
        Row that is eliminated first, second, ..., and its inverse: the place of each row.
    members, children : (s + 1,), (c,) int64
        Start of the children of each supernode, and all children.
    parity : (s,) int64
        0 for an even and 1 for an odd number of steps from a supernode up to its root.
    indefinite : bool
        Whether negative pivots are allowed.
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
    indefinite: bool


@loop
def place_panels(first: Ints, begin: Ints, kept: bool) -> tuple[Ints, Ints, Ints]:
    """Places of the panels of all supernodes.

    Returns
    -------
    panels : (s + 1,) int64
        Number of the first panel of each supernode.
    entries : (p + 1,) int64
        Start of the entries of each panel. If they are not kept, each supernode starts from zero.
    size : (s,) int64
        Entries of each supernode.
    """
    s = first.size - 1
    panels, size = np.zeros(s + 1, np.int64), np.zeros(s, np.int64)
    for k in range(s):
        panels[k + 1] = panels[k] + (first[k + 1] - first[k] + PANEL - 1) // PANEL
    entries = np.zeros(panels[s] + 1, np.int64)
    for k in range(s):
        c = first[k + 1] - first[k]
        front = c + begin[k + 1] - begin[k]
        if not kept:
            entries[panels[k]] = 0
        for j, p in enumerate(range(panels[k], panels[k + 1])):
            a = j * PANEL
            held = (front - a) * (min(a + PANEL, c) - a)
            entries[p + 1] = entries[p] + held
            size[k] += held
    return panels, entries, size


@loop
def depth_parity(parent: Ints) -> Ints:
    """Parity of each supernode: 0 for an even and 1 for an odd number of steps up to its root."""
    parity = np.zeros(parent.size, np.int64)
    for k in range(parent.size - 1, -1, -1):
        if parent[k] >= 0:
            parity[k] = 1 - parity[parent[k]]
    return parity


@loop
def stack_size(low: int, high: int, begin: Ints, members: Ints, children: Ints, parity: Ints) -> int:
    """Largest number of entries in both stacks of updates while supernodes are eliminated, see `eliminate`.

    Updates of children before ``low`` are added when they are needed.
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
    raised: NDArray[np.float64],
    table: Ints,
) -> int:
    """Eliminate supernodes, children before parents; return 0, or the number of the pivot that failed.

    Two stacks grow from both ends of ``updates``. The update of a supernode goes to one stack and the updates of its
    children to the other, so that it never has to move to their place. ``places`` (s,) is the start of each update,
    ``tops`` (2,) the size of each stack, and ``where`` (n,) work space. The part of the diagonal of L L^T that the
    negative columns add twice is added to ``raised`` (n,).
    """
    sizes = np.empty(8, np.int32)
    for k in range(low, high):
        children = given.children[given.members[k] : given.members[k + 1]]
        size, side = (blocks.begin[k + 1] - blocks.begin[k]) ** 2, given.parity[k]
        places[k] = tops[0] if side == 0 else updates.size - tops[1] - size
        _assemble(k, given, blocks, children, places, updates, where)
        failed = _eliminate_columns(k, blocks, given.indefinite, table, sizes)
        if failed:
            return int(failed)
        if given.indefinite:
            _add_raised(k, blocks, raised)
        _make_update(k, blocks, children, places, updates, where, table, sizes)
        tops[side] += size
        for child in children:
            tops[1 - side] -= (blocks.begin[child + 1] - blocks.begin[child]) ** 2
    return 0


@loop
def _assemble(
    k: int, given: Given, blocks: Blocks, children: Ints, places: Ints, updates: NDArray[Any], where: Rows
) -> None:
    """Assemble the columns of supernode k: those of the matrix, and the updates of its children."""
    start, c = blocks.first[k], blocks.first[k + 1] - blocks.first[k]
    below, panel = blocks.rows[blocks.begin[k] : blocks.begin[k + 1]], blocks.panels[k]
    front, values = c + below.size, blocks.values
    for j in range(c):
        where[start + j] = j
    for j in range(below.size):
        where[below[j]] = c + j
    last = blocks.panels[k + 1] - 1
    a = (last - panel) * PANEL
    values[blocks.entries[panel] : blocks.entries[last] + (front - a) * (c - a)] = 0
    for j in range(c):
        at = _column(blocks, panel, front, j)
        column = given.order[start + j]
        for p in range(given.starts[column], given.starts[column + 1]):
            row = given.indices[p]
            i = given.place[row]
            if i >= start + j and given.data[p] != 0:
                values[at + where[i]] += given.data[p] * given.scale[column] * given.scale[row]
    for child in children:
        to, ends = _runs(blocks.rows[blocks.begin[child] : blocks.begin[child + 1]], where)
        for q in range(to.size):
            if to[q] >= c:
                break
            _add(values, _column(blocks, panel, front, to[q]), updates, places[child] + q * to.size, q, to, ends)


@loop
def _column(blocks: Blocks, panel: int, front: int, j: int) -> int:
    """Start of column j of a front, as if it were stored from row 0 on; ``panel`` is the first panel of the front."""
    a = j // PANEL * PANEL
    return int(blocks.entries[panel + j // PANEL] + (j - a) * (front - a) - a)


@loop
def _panel(blocks: Blocks, k: int, panel: int) -> NDArray[Any]:
    """Entries (w, height) of a panel of supernode k, column by column."""
    c, a = blocks.first[k + 1] - blocks.first[k], (panel - blocks.panels[k]) * PANEL
    w, height = min(PANEL, c - a), c - a + blocks.begin[k + 1] - blocks.begin[k]
    start = blocks.entries[panel]
    return blocks.values[start : start + w * height].reshape(w, height)


@loop
def _signs(blocks: Blocks, k: int, panel: int) -> NDArray[np.int8]:
    """Signs (w,) of the columns of a panel of supernode k."""
    start = blocks.first[k] + (panel - blocks.panels[k]) * PANEL
    return blocks.signs[start : min(start + PANEL, blocks.first[k + 1])]


@loop
def _eliminate_columns(k: int, blocks: Blocks, indefinite: bool, table: Ints, sizes: Rows) -> int:
    """Eliminate the columns of supernode k, panel by panel; 0, or the number of the pivot that failed."""
    low, high = blocks.panels[k], blocks.panels[k + 1]
    for panel in range(low, high):
        P, signs = _panel(blocks, k, panel), _signs(blocks, k, panel)
        failed = eliminate_panel(P, signs, indefinite, table, sizes)
        if failed:
            return int(blocks.first[k] + (panel - low) * PANEL + failed)
        for later in range(panel + 1, high):
            C = _panel(blocks, k, later)
            first, to = (later - panel) * PANEL, (C.ctypes.data, C.shape[1])
            subtract_columns(P, signs, first, C.shape[0], to, table, sizes)
    return 0


@loop
def _add_raised(k: int, blocks: Blocks, raised: NDArray[np.float64]) -> None:
    """Add twice the squares of the negative columns of supernode k to their rows."""
    start, end = blocks.first[k], blocks.first[k + 1]
    below = blocks.rows[blocks.begin[k] : blocks.begin[k + 1]]
    for panel in range(blocks.panels[k], blocks.panels[k + 1]):
        P, signs = _panel(blocks, k, panel), _signs(blocks, k, panel)
        first = end - start - (panel - blocks.panels[k]) * PANEL
        for j in range(signs.size):
            if signs[j] < 0:
                for i in range(signs.size, first):
                    raised[end - first + i] += 2 * P[j, i] ** 2
                for i in range(below.size):
                    raised[below[i]] += 2 * P[j, first + i] ** 2


@loop
def _make_update(
    k: int,
    blocks: Blocks,
    children: Ints,
    places: Ints,
    updates: NDArray[Any],
    where: Rows,
    table: Ints,
    sizes: Rows,
) -> None:
    """Make the update of supernode k: minus the product of its rows, plus the rest of its children's updates."""
    c, r = blocks.first[k + 1] - blocks.first[k], blocks.begin[k + 1] - blocks.begin[k]
    if not r:
        return
    rest, low = updates.ctypes.data + places[k] * updates.itemsize, blocks.panels[k]
    for panel in range(low, blocks.panels[k + 1]):
        P, signs = _panel(blocks, k, panel), _signs(blocks, k, panel)
        update_rest(P, signs, c - (panel - low) * PANEL, (rest, r), panel == low, table, sizes)
    for child in children:
        to, ends = _runs(blocks.rows[blocks.begin[child] : blocks.begin[child + 1]], where)
        for q in range(to.size):
            if to[q] >= c:
                _add(updates, places[k] + (to[q] - c) * r - c, updates, places[child] + q * to.size, q, to, ends)


@loop
def _runs(rows: Rows, where: Rows) -> tuple[Rows, Rows]:
    """Places of a child's rows in the front, and for each row the end of its run of consecutive places."""
    at, ends = np.empty(rows.size, np.int32), np.empty(rows.size, np.int32)
    for i in range(rows.size):
        at[i] = where[rows[i]]
    for i in range(rows.size - 1, -1, -1):
        joined = i + 1 < rows.size and at[i + 1] == at[i] + 1
        ends[i] = ends[i + 1] if joined else i + 1
    return at, ends


@loop
def _add(into: NDArray[Any], at: int, updates: NDArray[Any], source: int, q: int, to: Rows, ends: Rows) -> None:
    """Add column q of an update, from its diagonal on, to the column that starts at ``at``."""
    i = q
    while i < to.size:
        # Unsigned places cannot count from the end of an array, so that the compiler adds several entries at a time.
        here, part = np.uint64(at + to[i]), np.uint64(source + i)
        for d in range(np.uint64(ends[i] - i)):
            into[here + d] += updates[part + d]
        i = ends[i]
