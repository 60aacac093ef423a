"""Products of tall blocks, compiled: each row is read once, by one of some threads."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.narrow_products import AT_ONCE, SPARE, Part, padded, subtract, subtract_transposed
from cmsreduce.linalg.row_shares import share_rows
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["streamed_combination", "streamed_inner", "streamed_less", "streamed_times"]

Array = NDArray[np.float64]

# Values of right-hand sides, 2.5 MB, that stay at hand while all blocks pass by.
_VALUES = 320_000


def streamed_inner(blocks: Sequence[Array], W: Array) -> Array:
    """V^T W (m, k) of blocks V = [V_1, V_2, ...] (n, m) that lie by columns or by rows, and a block W (n, k)."""
    (n, k), threads, width = W.shape, current_settings().thread_count, padded(W.shape[1])
    parts = [_part(V) for V in blocks]
    sums = [np.zeros((threads, (part.columns + SPARE) * width)) for part in parts]

    def work(thread: int, rows: slice) -> None:
        Y = _by_rows(W[rows], width)
        for part, X in zip(parts, sums, strict=True):
            _inner(part, rows.start, rows.stop, X[thread], Y, width)

    share_rows(n, _height(width), work)
    # Always in the same order: a sum does not depend on which thread was first.
    totals = [X.sum(axis=0).reshape(-1, max(width, 1)) for X in sums]
    return np.vstack([np.empty((0, k)), *(-X[: part.columns, :k] for part, X in zip(parts, totals, strict=True))])


def streamed_less(W: Array, blocks: Sequence[Array], c: Array) -> Array:
    """W - V c in the memory of W (n, k), for blocks V = [V_1, V_2, ...] (n, m) that lie by columns or by rows."""
    width, factors = padded(W.shape[1]), _factors(blocks, c)

    def work(_: int, rows: slice) -> None:
        Y = _by_rows(W[rows], width)
        for part, X in factors:
            _less(part, rows.start, rows.stop, X, Y, width)
        if not np.may_share_memory(Y, W):
            _give(Y, width, W, rows.start, rows.stop)

    share_rows(W.shape[0], _height(width), work)
    return W


def streamed_combination(blocks: Sequence[Array], S: Array) -> Array:
    """V S (n, k), by columns, of blocks V = [V_1, V_2, ...] (n, m) that lie by columns or by rows."""
    found = np.empty((blocks[0].shape[0], S.shape[1]), order="F")
    width, factors = padded(S.shape[1]), _factors(blocks, -S)

    def work(_: int, rows: slice) -> None:
        Y = np.zeros((rows.stop - rows.start) * width)
        for part, X in factors:
            _less(part, rows.start, rows.stop, X, Y, width)
        _give(Y, width, found, rows.start, rows.stop)

    share_rows(found.shape[0], _height(width), work)
    return found


def streamed_times(W: Array, C: Array) -> Array:
    """W C in the memory of W (n, m), which lies by columns or by rows, for a matrix C (m, k) with k <= m."""
    k, width = C.shape[1], padded(C.shape[1])
    part, X = _part(W), _filled_up(-C, width)
    share_rows(W.shape[0], _height(width), lambda _, rows: _times(part, rows.start, rows.stop, X, width, k))
    return W[:, :k]


def _part(V: Array) -> Part:
    """A block as products take it; one that lies neither by columns nor by rows is copied."""
    if V.itemsize not in V.strides or min(V.strides) <= 0:
        V = np.ascontiguousarray(V)
    (n, m), (down, across) = V.shape, (step // V.itemsize for step in V.strides)
    # All entries from the first to the last, whatever lies between columns, or between rows.
    size = (n - 1) * down + (m - 1) * across + 1 if V.size else 0
    return Part(np.lib.stride_tricks.as_strided(V, shape=(size,), strides=(V.itemsize,)), 0, across, down, m, n)


def _factors(blocks: Sequence[Array], c: Array) -> list[tuple[Part, Array]]:
    """Blocks V = [V_1, V_2, ...] and the rows of c (m, k) that each is multiplied by."""
    ends = np.cumsum([0, *(V.shape[1] for V in blocks)])
    width = padded(c.shape[1])
    rows = (_filled_up(c[first:last], width) for first, last in pairwise(ends))
    return [(_part(V), X) for V, X in zip(blocks, rows, strict=True)]


def _filled_up(c: Array, width: int) -> Array:
    """Rows of a matrix as products read them: each filled up with zeros, and some to spare."""
    X = np.zeros((c.shape[0] + SPARE, width))
    X[: c.shape[0], : c.shape[1]] = c
    return X.reshape(-1)


def _height(width: int) -> int:
    """Rows whose right-hand sides stay at hand."""
    return max(_VALUES // max(width, 1), AT_ONCE)


def _by_rows(W: Array, width: int) -> Array:
    """Entries of a block, row by row, each filled up with zeros: the block itself where it lies so."""
    if W.flags.c_contiguous and W.shape[1] == width:
        return W.reshape(-1)
    Y = np.empty(W.shape[0] * width)
    _take(W, width, Y)
    return Y


@loop
def _some(V: Part, low: int, high: int) -> Part:
    """Some rows of a block."""
    return Part(V.values, V.at + low * V.down, V.across, V.down, V.columns, high - low)


@loop
def _inner(V: Part, first: int, last: int, X: Array, Y: Array, width: int) -> None:
    """X = X - V^T Y, of some rows of V, which are all of Y."""
    for low in range(first, last, AT_ONCE):
        rows = _some(V, low, min(low + AT_ONCE, last))
        subtract_transposed(rows, X, 0, Y, (low - first) * width, width)


@loop
def _less(V: Part, first: int, last: int, X: Array, Y: Array, width: int) -> None:
    """Y = Y - V X, of some rows of V, which are all of Y."""
    for low in range(first, last, AT_ONCE):
        subtract(_some(V, low, min(low + AT_ONCE, last)), X, 0, Y, (low - first) * width, width)


@loop
def _times(W: Part, first: int, last: int, X: Array, width: int, k: int) -> None:
    """W = -W X, of some rows of W."""
    Y = np.empty(AT_ONCE * width)
    for low in range(first, last, AT_ONCE):
        rows = _some(W, low, min(low + AT_ONCE, last))
        Y[:] = 0
        subtract(rows, X, 0, Y, 0, width)
        if k == width and k == W.down:
            W.values[rows.at : rows.at + rows.rows * k] = Y[: rows.rows * k]
        else:
            for q in range(k):
                for i in range(rows.rows):
                    W.values[rows.at + i * W.down + q * W.across] = Y[i * width + q]


@loop
def _take(W: Array, width: int, Y: Array) -> None:
    """Rows of W, one after the other, each filled up with zeros."""
    for low in range(0, W.shape[0], AT_ONCE):
        high = min(low + AT_ONCE, W.shape[0])
        for q in range(W.shape[1]):
            for i in range(low, high):
                Y[i * width + q] = W[i, q]
        for i in range(low, high):
            Y[i * width + W.shape[1] : (i + 1) * width] = 0


@loop
def _give(Y: Array, width: int, W: Array, first: int, last: int) -> None:
    """Some rows to W."""
    for low in range(first, last, AT_ONCE):
        high = min(low + AT_ONCE, last)
        for q in range(W.shape[1]):
            for i in range(low, high):
                W[i, q] = Y[(i - first) * width + q]
