"""Orthonormal columns of a search, which grow by blocks: in memory as they come, or on disk where they outgrow it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.basis_store import working_space
from cmsreduce.linalg.tall_products import inner, less

__all__ = ["SearchSpace"]

Array = NDArray[np.float64]

# Columns that are allocated at a time: wide enough for dense products, small enough for memory that was freed before.
_COLUMNS = 48
# Rows that are combined at a time.
_ROWS = 4096


class SearchSpace:
    """Columns V (n, m), of which some more may come.

    Parameters
    ----------
    n : int
        Rows.
    most : int
        Columns at most.
    """

    def __init__(self, n: int, most: int) -> None:
        self.n, self.m = n, 0
        self._most, self._chunk = most, min(_COLUMNS, most)
        self._chunks: list[Array] = []

    @property
    def _filled(self) -> list[Array]:
        """Arrays that lie side by side."""
        full = range(0, self.m, self._chunk)
        return [chunk[:, : self.m - first] for chunk, first in zip(self._chunks, full, strict=False)]

    def append(self, X: Array) -> Array:
        """Add columns (n, k), and return them as they lie here."""
        first, k = self.m, X.shape[1]
        while self.m < first + k:
            chunk, used = divmod(self.m, self._chunk)
            if chunk == len(self._chunks):
                self._chunks.append(working_space(self.n, self._chunk, most=self._most))
            rest = X[:, self.m - first :]
            here = self._chunks[chunk][:, used : used + rest.shape[1]]
            here[:] = rest[:, : here.shape[1]]
            self.m += here.shape[1]
        return here if k and here.shape[1] == k else X

    def inner(self, W: Array) -> Array:
        """V^T W (m, k)."""
        return np.vstack([np.empty((0, W.shape[1])), *(inner(chunk, W) for chunk in self._filled)])

    def taken_from(self, W: Array, c: Array) -> Array:
        """W - V c in the memory of W, (n, k) in Fortran order."""
        first = 0
        for chunk in self._filled:
            W = less(W, chunk, c[first : first + chunk.shape[1]])
            first += chunk.shape[1]
        return W

    def combined(self, S: Array) -> Array:
        """V S (n, k), in Fortran order."""
        return self.taken_from(np.zeros((self.n, S.shape[1]), order="F"), -S)

    def shrink(self, S: Array) -> None:
        """Replace the columns by V S, for S (m, k) with k <= m."""
        k, filled = S.shape[1], self._filled
        parts = np.split(S, np.cumsum([chunk.shape[1] for chunk in filled])[:-1])
        self.m = k
        for start in range(0, self.n, _ROWS):
            rows = slice(start, start + _ROWS)
            combined = np.sum([chunk[rows] @ part for chunk, part in zip(filled, parts, strict=True)], axis=0)
            for first, chunk in zip(range(0, k, self._chunk), filled, strict=False):
                chunk[rows, : k - first] = combined[:, first : first + chunk.shape[1]]
