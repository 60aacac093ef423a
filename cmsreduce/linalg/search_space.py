"""Orthonormal columns of a search, which grow by blocks: in memory as they come, or on disk where they outgrow it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.basis_store import kept_by_rows, search_outgrows
from cmsreduce.linalg.layout import by_rows
from cmsreduce.linalg.tall_products import combination, inner_of_all, less_all

__all__ = ["SearchSpace"]

Array = NDArray[np.float64]

# Rows that are combined at a time.
_ROWS = 4096


class SearchSpace:
    """Columns V (n, m), of which some more may come; each block lies by rows, for it is read as a whole.

    Parameters
    ----------
    n : int
        Rows.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        self._blocks: list[Array] = []
        # Columns that are known to have room in memory.
        self._sure = 0

    @property
    def m(self) -> int:
        """Columns."""
        return sum(block.shape[1] for block in self._blocks)

    def append(self, X: Array) -> Array:
        """Add columns (n, k), and return them as they are kept: themselves, if they may be, from now on unchanged."""
        wanted = self.m + X.shape[1]
        if wanted > self._sure and not search_outgrows(self.n, 2 * wanted):
            # To ask the system takes as long as a product with all columns.
            self._sure = 2 * wanted
        kept = by_rows(X) if wanted <= self._sure else kept_by_rows(X, self.m)
        if kept.shape[1]:
            self._blocks.append(kept)
        return kept

    def inner(self, W: Array) -> Array:
        """V^T W (m, k)."""
        return inner_of_all(self._blocks, W)

    def taken_from(self, W: Array, c: Array) -> Array:
        """W - V c in the memory of W, (n, k) by columns or by rows."""
        return less_all(W, self._blocks, c)

    def combined(self, S: Array, *beside: Array) -> Array:
        """V S (n, k), in Fortran order; [V, X] S with columns X ``beside``."""
        blocks = [*self._blocks, *beside]
        return combination(blocks, S) if blocks else np.zeros((self.n, S.shape[1]), order="F")

    def shrink(self, S: Array) -> None:
        """Replace the columns by V S, for S (m, k) with k <= m."""
        before, kept = self._blocks, S.shape[1]
        starts = np.cumsum([0, *(block.shape[1] for block in before)]).tolist()
        self._blocks = [block[:, : kept - start] for block, start in zip(before, starts, strict=False) if start < kept]
        for first in range(0, self.n, _ROWS):
            rows = slice(first, first + _ROWS)
            combined = np.hstack([block[rows] for block in before]) @ S
            for block, start in zip(self._blocks, starts, strict=False):
                block[rows] = combined[:, start : start + block.shape[1]]
