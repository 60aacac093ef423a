"""Forward and back substitution with the dense blocks of a supernodal factor, for blocks of right-hand sides."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.blas import PLAIN, TRANSPOSED, subtract_product
from cmsreduce.multifrontal.fronts import Blocks
from cmsreduce.multifrontal.loops import loop
from cmsreduce.multifrontal.panels import PANEL, STRIP, solve_panel

__all__ = ["backward", "forward", "gather", "largest", "pivots_of", "spread"]

Ints = NDArray[np.int64]

# Rows of a panel in one product: their right-hand sides stay in the cache.
_AT_ONCE = 256
# Columns of a panel in one product with a narrow block. Forward, BLAS walks along the rows of the factor: few columns
# are read as so many streams. Back, it walks down the columns, and products of 256 rows and 32 columns are not copied.
_FORWARD, _BACK = 16, 32


@loop
def largest(b: NDArray[Any], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest absolute value in each column of a block (n, k) with scaled rows; 1 for a column of zeros."""
    found = np.zeros(b.shape[1])
    for i in range(b.shape[0]):
        for q in range(b.shape[1]):
            found[q] = max(found[q], abs(b[i, q] * scale[i]))
    return np.where(found > 0, found, 1.0)


@loop
def gather(
    low: int,
    high: int,
    b: NDArray[Any],
    order: Ints,
    scale: NDArray[np.float64],
    size: NDArray[np.float64],
    W: NDArray[Any],
) -> None:
    """Write rows low to high of W: rows of b in the order of elimination, scaled, each column divided by its size."""
    k = b.shape[1]
    for i in range(low, high):
        row = order[i]
        for q in range(k):
            W[i, q] = b[row, q] * scale[row] / size[q]


@loop
def spread(
    low: int,
    high: int,
    W: NDArray[Any],
    order: Ints,
    scale: NDArray[np.float64],
    size: NDArray[np.float64],
    x: NDArray[Any],
) -> None:
    """Reverse of `gather`: rows low to high of W into x, scaled, each column multiplied by its size."""
    for i in range(low, high):
        row = order[i]
        for q in range(x.shape[1]):
            x[row, q] = W[i, q] * scale[row] * size[q]


@loop
def forward(supernodes: Ints, blocks: Blocks, W: NDArray[Any], shared: int, changes: NDArray[Any], table: Ints) -> None:
    """Solve with L, then with S, for a block W (n, k) in place, supernode by supernode.

    W is stored by rows: BLAS reads it by columns as W^T (k, n). Changes of rows from ``shared`` on are summed in
    ``changes``, because other threads change these rows too.
    """
    k, step, base, here = W.shape[1], W.itemsize, blocks.values.ctypes.data, W.ctypes.data
    Y, sizes = np.empty((_AT_ONCE, k), W.dtype), np.empty(8, np.int32)
    few = _FORWARD // 2 if k <= _FORWARD // 2 else _FORWARD
    for s in supernodes:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s], blocks.panels[s + 1]):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, height = c - a - w, c - a + below.size
            triangle, X = base + blocks.entries[panel] * step, here + (start + a) * k * step
            signs = blocks.signs[start + a : start + a + w]
            solve_panel(signs, (triangle, height), W, start + a, TRANSPOSED, table, sizes)
            for low in range(w, height, _AT_ONCE):
                rows = min(_AT_ONCE, height - low)
                Y[:rows] = 0
                for j in range(0, w, few):
                    part, x = triangle + (j * height + low) * step, X + j * k * step
                    shape = k, rows, min(few, w - j)
                    subtract_product(table, sizes, shape, (x, k), (part, height), (Y.ctypes.data, k), TRANSPOSED)
                for i in range(rows):
                    j = low + i - w
                    row = start + a + w + j if j < own else below[j - own]
                    if row < shared:
                        for q in range(k):
                            W[row, q] += Y[i, q]
                    else:
                        for q in range(k):
                            changes[row - shared, q] += Y[i, q]
            for j in range(w):
                if signs[j] < 0:
                    for q in range(k):
                        W[start + a + j, q] = -W[start + a + j, q]


@loop
def backward(supernodes: Ints, blocks: Blocks, W: NDArray[Any], table: Ints) -> None:
    """Solve with L^T for a block W (n, k) in place, supernode by supernode from the last one."""
    k, step, base, here = W.shape[1], W.itemsize, blocks.values.ctypes.data, W.ctypes.data
    Y, sizes = np.empty((_AT_ONCE, k), W.dtype), np.empty(8, np.int32)
    for s in supernodes[::-1]:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s + 1] - 1, blocks.panels[s] - 1, -1):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, height = c - a - w, c - a + below.size
            triangle, X = base + blocks.entries[panel] * step, here + (start + a) * k * step
            for low in range(w, height, _AT_ONCE):
                rows = min(_AT_ONCE, height - low)
                for i in range(rows):
                    j = low + i - w
                    row = start + a + w + j if j < own else below[j - own]
                    for q in range(k):
                        Y[i, q] = W[row, q]
                for j in range(0, w, _BACK):
                    part, x = triangle + (j * height + low) * step, X + j * k * step
                    shape = k, min(_BACK, w - j), rows
                    subtract_product(table, sizes, shape, (Y.ctypes.data, k), (part, height), (x, k), PLAIN)
            signs = blocks.signs[start + a : start + a + w]
            solve_panel(signs, (triangle, height), W, start + a, PLAIN, table, sizes)


@loop
def pivots_of(low: int, high: int, blocks: Blocks, found: NDArray[np.float64]) -> None:
    """Write the pivots, in the order of elimination, for the columns of supernodes low to high.

    They are the squares of the diagonal of L; in a diagonalised block, its eigenvalues.
    """
    for s in range(low, high):
        c = blocks.first[s + 1] - blocks.first[s]
        front = c + blocks.begin[s + 1] - blocks.begin[s]
        for j in range(c):
            a, column = j // PANEL * PANEL, blocks.first[s] + j
            at = blocks.entries[blocks.panels[s] + j // PANEL] + (j - a) * (front - a + 1)
            if blocks.signs[column] == 0:
                found[column] = np.float64(blocks.values[at]) ** 2
            else:
                before, squares = (j - a) % STRIP, 0.0
                for i in range(min(STRIP, c - j + before)):
                    squares += blocks.values[at - before + i] ** 2
                found[column] = blocks.signs[column] / squares
