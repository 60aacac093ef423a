"""Forward and back substitution with the dense blocks of a supernodal factor, for many right-hand sides at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cmsreduce.linalg.blas_calls import multiply, solve_block
from cmsreduce.linalg.fronts import PANEL, Blocks

__all__ = ["backward", "diagonal", "forward", "gather", "largest", "spread"]

Ints = NDArray[np.int64]


@njit(cache=True, nogil=True)
def largest(b: NDArray[Any], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest size of an entry of each column of a block (n, k) whose rows are scaled; 1 for a column of zeros."""
    found = np.zeros(b.shape[1])
    for i in range(b.shape[0]):
        for q in range(b.shape[1]):
            found[q] = max(found[q], abs(b[i, q] * scale[i]))
    return np.where(found > 0, found, 1.0)


@njit(cache=True, nogil=True)
def gather(
    b: NDArray[Any], order: Ints, scale: NDArray[np.float64], size: NDArray[np.float64], W: NDArray[Any]
) -> None:
    """Rows of a block in the order of elimination, scaled, each column divided by its size."""
    for i in range(order.size):
        row = order[i]
        for q in range(W.shape[1]):
            W[i, q] = b[row, q] * scale[row] / size[q]


@njit(cache=True, nogil=True)
def spread(
    W: NDArray[Any], order: Ints, scale: NDArray[np.float64], size: NDArray[np.float64], x: NDArray[Any]
) -> None:
    """Rows of a block back where they were, scaled, each column multiplied by its size."""
    for i in range(order.size):
        row = order[i]
        for q in range(W.shape[1]):
            x[row, q] = W[i, q] * scale[row] * size[q]


@njit(cache=True, nogil=True)
def forward(chosen: Ints, blocks: Blocks, W: NDArray[Any], shared: int, apart: NDArray[Any], table: Ints) -> None:
    """Solve with L for a block W (n, k) in place, supernode by supernode.

    What is taken from rows from ``shared`` on is added up in ``apart``, for another thread may take from them too.
    """
    k, sizes, step = W.shape[1], np.empty(8, np.int32), blocks.values.itemsize
    work = np.empty((PANEL + _longest(chosen, blocks)) * k, blocks.values.dtype)
    for s in chosen:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s], blocks.panels[s + 1]):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, m = c - a - w, c - a - w + below.size
            here, x, taken = blocks.values.ctypes.data + blocks.entries[panel] * step, work.ctypes.data, w * k
            for j in range(w):
                for q in range(k):
                    work[q * w + j] = W[start + a + j, q]
            solve_block(table, sizes, True, False, (w, k), (here, w + m), (x, w))
            for j in range(w):
                for q in range(k):
                    W[start + a + j, q] = work[q * w + j]
            if not m:
                continue
            source, to = (here + w * step, w + m), (x + taken * step, m)
            multiply(table, sizes, False, (m, k, w), source, (x, w, False), to, True, 1)
            for i in range(own):
                for q in range(k):
                    W[start + a + w + i, q] -= work[taken + q * m + i]
            for i in range(own, m):
                row = below[i - own]
                if row < shared:
                    for q in range(k):
                        W[row, q] -= work[taken + q * m + i]
                else:
                    for q in range(k):
                        apart[row - shared, q] -= work[taken + q * m + i]


@njit(cache=True, nogil=True)
def backward(chosen: Ints, blocks: Blocks, W: NDArray[Any], table: Ints) -> None:
    """Solve with L^T for a block W (n, k) in place, the last of some supernodes first."""
    k, sizes, step = W.shape[1], np.empty(8, np.int32), blocks.values.itemsize
    work = np.empty((PANEL + _longest(chosen, blocks)) * k, blocks.values.dtype)
    for s in chosen[::-1]:
        start, c = blocks.first[s], blocks.first[s + 1] - blocks.first[s]
        below = blocks.rows[blocks.begin[s] : blocks.begin[s + 1]]
        for panel in range(blocks.panels[s + 1] - 1, blocks.panels[s] - 1, -1):
            a = (panel - blocks.panels[s]) * PANEL
            w = min(PANEL, c - a)
            own, m = c - a - w, c - a - w + below.size
            here, x, taken = blocks.values.ctypes.data + blocks.entries[panel] * step, work.ctypes.data, w * k
            for i in range(own):
                for q in range(k):
                    work[taken + q * m + i] = W[start + a + w + i, q]
            for i in range(own, m):
                for q in range(k):
                    work[taken + q * m + i] = W[below[i - own], q]
            for j in range(w):
                for q in range(k):
                    work[q * w + j] = W[start + a + j, q]
            if m:
                source, known = (here + w * step, w + m), (x + taken * step, m, False)
                multiply(table, sizes, True, (w, k, m), source, known, (x, w), False, -1)
            solve_block(table, sizes, True, True, (w, k), (here, w + m), (x, w))
            for j in range(w):
                for q in range(k):
                    W[start + a + j, q] = work[q * w + j]


@njit(cache=True)
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


@njit(cache=True)
def _longest(chosen: Ints, blocks: Blocks) -> int:
    """Rows of the largest front of some supernodes."""
    longest = 0
    for s in chosen:
        longest = max(longest, blocks.first[s + 1] - blocks.first[s] + blocks.begin[s + 1] - blocks.begin[s])
    return longest
