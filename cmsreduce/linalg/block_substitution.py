"""Forward and back substitution with the dense blocks of a supernodal factor, for many right-hand sides at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.fronts import PANEL, Blocks
from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.narrow_products import AT_ONCE, SPARE, Part, subtract, subtract_transposed
from cmsreduce.linalg.register_kernels import COLUMNS

__all__ = ["backward", "diagonal", "forward", "gather", "largest", "spread"]

Ints = NDArray[np.int64]


@loop
def largest(b: NDArray[Any], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest size of an entry of each column of a block (n, k) whose rows are scaled; 1 for a column of zeros."""
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
    """Rows low, ... of a block in the order of elimination, scaled, each column divided by its size; zeros beyond."""
    k = b.shape[1]
    for i in range(low, high):
        row = order[i]
        for q in range(k):
            W[i, q] = b[row, q] * scale[row] / size[q]
        W[i, k:] = 0


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
    """Rows low, ... in the order of elimination back where they were, scaled, each column multiplied by its size."""
    for i in range(low, high):
        row = order[i]
        for q in range(x.shape[1]):
            x[row, q] = W[i, q] * scale[row] * size[q]


@loop
def forward(chosen: Ints, blocks: Blocks, W: NDArray[Any], shared: int, apart: NDArray[Any]) -> None:
    """Solve with L for a block W (n, k) in place, supernode by supernode.

    What is taken from rows from ``shared`` on is added up in ``apart``, for another thread may take from them too.
    """
    k = W.shape[1]
    X, Y = np.empty((PANEL + SPARE) * k, W.dtype), np.empty(AT_ONCE * k, W.dtype)
    for s in chosen:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s], blocks.panels[s + 1]):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, height, at = c - a - w, c - a + below.size, blocks.entries[panel]
            triangle = Part(blocks.values, at, height, 1, w, w)
            _take(W, start + a, w, X)
            _solve_forward(triangle, X, k)
            _give(X, start + a, w, W)
            for low in range(w, height, AT_ONCE):
                rows = min(AT_ONCE, height - low)
                Y[: rows * k] = 0
                subtract(Part(blocks.values, at + low, height, 1, w, rows), X, 0, Y, 0, k)
                for i in range(rows):
                    j = low + i - w
                    row = start + a + w + j if j < own else below[j - own]
                    if row < shared:
                        for q in range(k):
                            W[row, q] += Y[i * k + q]
                    else:
                        for q in range(k):
                            apart[row - shared, q] += Y[i * k + q]


@loop
def backward(chosen: Ints, blocks: Blocks, W: NDArray[Any]) -> None:
    """Solve with L^T for a block W (n, k) in place, the last of some supernodes first."""
    k = W.shape[1]
    X, Y = np.empty((PANEL + SPARE) * k, W.dtype), np.empty(AT_ONCE * k, W.dtype)
    for s in chosen[::-1]:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s + 1] - 1, blocks.panels[s] - 1, -1):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, height, at = c - a - w, c - a + below.size, blocks.entries[panel]
            triangle = Part(blocks.values, at, height, 1, w, w)
            _take(W, start + a, w, X)
            for low in range(w, height, AT_ONCE):
                rows = min(AT_ONCE, height - low)
                for i in range(rows):
                    j = low + i - w
                    row = start + a + w + j if j < own else below[j - own]
                    for q in range(k):
                        Y[i * k + q] = W[row, q]
                subtract_transposed(Part(blocks.values, at + low, height, 1, w, rows), X, 0, Y, 0, k)
            _solve_backward(triangle, X, k)
            _give(X, start + a, w, W)


@loop
def _take(W: NDArray[Any], first: int, w: int, X: NDArray[Any]) -> None:
    """Rows of W, one after the other, and zeros for the columns that a product reads beyond the last."""
    k = W.shape[1]
    for j in range(w):
        for q in range(k):
            X[j * k + q] = W[first + j, q]
    X[w * k : (w + SPARE) * k] = 0


@loop
def _give(X: NDArray[Any], first: int, w: int, W: NDArray[Any]) -> None:
    """Rows back to W."""
    k = W.shape[1]
    for j in range(w):
        for q in range(k):
            W[first + j, q] = X[j * k + q]


@loop
def _solve_forward(panel: Part, X: NDArray[Any], k: int) -> None:
    """X = L^-1 X for the triangle of a panel, some columns at a time."""
    values = panel.values
    for j in range(0, panel.columns, COLUMNS):
        end = min(j + COLUMNS, panel.columns)
        for i in range(j, end):
            column = panel.at + i * panel.across
            for q in range(i * k, i * k + k):
                X[q] /= values[column + i]
            for r in range(i + 1, end):
                for q in range(k):
                    X[r * k + q] -= values[column + r] * X[i * k + q]
        subtract(_below(panel, j, end), X, j * k, X, end * k, k)


@loop
def _solve_backward(panel: Part, X: NDArray[Any], k: int) -> None:
    """X = L^-T X."""
    values = panel.values
    for j in range((panel.columns - 1) // COLUMNS * COLUMNS, -1, -COLUMNS):
        end = min(j + COLUMNS, panel.columns)
        subtract_transposed(_below(panel, j, end), X, j * k, X, end * k, k)
        for i in range(end - 1, j - 1, -1):
            column = panel.at + i * panel.across
            for r in range(i + 1, end):
                for q in range(k):
                    X[i * k + q] -= values[column + r] * X[r * k + q]
            for q in range(i * k, i * k + k):
                X[q] /= values[column + i]


@loop
def _below(panel: Part, j: int, end: int) -> Part:
    """What columns j to ``end`` have below them within the triangle."""
    return Part(panel.values, panel.at + j * panel.across + end, panel.across, 1, end - j, panel.columns - end)


@loop
def diagonal(blocks: Blocks) -> NDArray[np.float64]:
    """Diagonal of L, in the order of elimination."""
    found = np.empty(blocks.first[-1])
    for s in range(blocks.first.size - 1):
        c = blocks.first[s + 1] - blocks.first[s]
        front = c + blocks.begin[s + 1] - blocks.begin[s]
        for j in range(c):
            a = j // PANEL * PANEL
            found[blocks.first[s] + j] = blocks.values[
                blocks.entries[blocks.panels[s] + j // PANEL] + (j - a) * (front - a + 1)
            ]
    return found
