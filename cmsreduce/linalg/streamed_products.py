"""Products of tall blocks, compiled: each row is read once, by one of some threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.narrow_products import AT_ONCE, SPARE, Part, padded, subtract, subtract_transposed
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["streamed_inner", "streamed_less"]

Array = NDArray[np.float64]


def streamed_inner(V: Array, W: Array) -> Array:
    """V^T W (m, k) of a block V (n, m) that lies by columns and a block W (n, k)."""
    (n, m), k = V.shape, W.shape[1]
    values, height, threads = _flat(V), V.strides[1] // V.itemsize, current_settings().thread_count
    X = np.zeros((threads, (m + SPARE) * padded(k)))
    _share_rows(n, threads, lambda t, low, high: _inner(values, height, m, W, low, high, X[t]))
    # Always in the same order: a sum does not depend on which thread was first.
    return np.asarray(-X.sum(axis=0).reshape(m + SPARE, -1)[:m, :k])


def streamed_less(W: Array, V: Array, c: Array) -> Array:
    """W - V c in the memory of W (n, k), for a block V (n, m) that lies by columns."""
    (n, m), k = V.shape, W.shape[1]
    values, height = _flat(V), V.strides[1] // V.itemsize
    X = np.zeros((m + SPARE, padded(k)))
    X[:m, :k] = c
    flat = X.ravel()
    _share_rows(n, current_settings().thread_count, lambda _, low, high: _less(values, height, m, W, low, high, flat))
    return W


def _share_rows(n: int, threads: int, work: Callable[[int, int, int], None]) -> None:
    """Call ``work`` in each thread with its number and its rows."""
    cuts = np.linspace(0, n, threads + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda t: work(t, cuts[t], cuts[t + 1]), range(threads)))


def _flat(V: Array) -> Array:
    """All entries from the first to the last, whatever lies between columns."""
    step = V.strides[1] // V.itemsize
    return np.lib.stride_tricks.as_strided(V, shape=((V.shape[1] - 1) * step + V.shape[0],), strides=(V.itemsize,))


@loop
def _inner(values: Array, height: int, m: int, W: Array, first: int, last: int, X: Array) -> None:
    """X = X - V^T W, of some rows."""
    k = X.size // (m + SPARE)
    Y = np.zeros(AT_ONCE * k)
    for low in range(first, last, AT_ONCE):
        rows = min(AT_ONCE, last - low)
        for i in range(rows):
            for q in range(W.shape[1]):
                Y[i * k + q] = W[low + i, q]
        subtract_transposed(Part(values, low, height, m, rows), X, 0, Y, 0, k)


@loop
def _less(values: Array, height: int, m: int, W: Array, first: int, last: int, X: Array) -> None:
    """W = W - V X, of some rows."""
    k = X.size // (m + SPARE)
    Y = np.zeros(AT_ONCE * k)
    for low in range(first, last, AT_ONCE):
        rows = min(AT_ONCE, last - low)
        for i in range(rows):
            for q in range(W.shape[1]):
                Y[i * k + q] = W[low + i, q]
        subtract(Part(values, low, height, m, rows), X, 0, Y, 0, k)
        for i in range(rows):
            for q in range(W.shape[1]):
                W[low + i, q] = Y[i * k + q]
