"""Bases of shapes: in memory, or on disk where they outgrow it, and what is done with them by rows and by columns.

Orthonormal columns of a search, which grow by blocks: in memory as they come, or on disk where they outgrow it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks.layout import by_rows
from cmsreduce.linalg.blocks.products import column_blocks, symmetric_product
from cmsreduce.linalg.blocks.tall_products import combination, inner_of_all, less_all
from cmsreduce.linalg.machine import current_settings
from cmsreduce.model import mapped_array, mapped_in, shapes_beside

__all__ = [
    "SearchSpace",
    "absolute_parts",
    "combine",
    "combined",
    "kept_by_rows",
    "new_basis",
    "observed",
    "outgrows",
    "row_blocks",
    "search_outgrows",
    "side_by_side",
]

Array = NDArray[np.float64]

# Values of a block of rows, 8 MiB: far less than a block of columns, and still long runs of every column on disk.
_VALUES = 2**20
# A search may take so many times the memory of a basis.
_SEARCHES = 3


def new_basis(n: int, m: int) -> Array:
    """Room for shapes (n, m), all zero, in Fortran order.

    They are on disk where they would take more memory than `SolverSettings.basis_limit`, and the settings say where.
    """
    folder = current_settings().scratch
    if folder is None or not outgrows(n, m):
        return np.zeros((n, m), order="F")
    return mapped_array(folder, n, m)


def search_outgrows(n: int, m: int) -> bool:
    """Whether a search over vectors (n, m) is to be on disk: there is one at a time, which may take several bases."""
    return outgrows(n, m // _SEARCHES)


def kept_by_rows(X: Array, beside: int) -> Array:
    """Columns (n, k) of a search by rows: themselves, or on disk where with those ``beside`` they outgrow memory."""
    folder, (n, k) = current_settings().scratch, X.shape
    if folder is None or not k or not search_outgrows(n, beside + k):
        return by_rows(X)
    place = mapped_array(folder, n, k, by_rows=True)
    for rows in row_blocks(n, k):
        place[rows] = X[rows]
    return place


def outgrows(n: int, m: int) -> bool:
    """Whether a basis (n, m) is to be on disk."""
    settings = current_settings()
    return settings.scratch is not None and np.dtype(np.float64).itemsize * n * m > settings.basis_limit


def row_blocks(n: int, m: int) -> Iterator[slice]:
    """Rows of a basis (n, m), some at a time."""
    height = max(_VALUES // max(m, 1), 1)
    return (slice(first, min(first + height, n)) for first in range(0, n, height))


def combined(Phi: Array, V: Array) -> Array:
    """Combinations Phi V of shapes (n, m), for V (m, k): on disk where these are, or where they outgrow memory."""
    n, k = Phi.shape[0], V.shape[1]
    found = new_basis(n, k) if mapped_in(Phi) is None else shapes_beside(Phi, k)
    for rows in row_blocks(n, max(Phi.shape[1], k)):
        found[rows] = Phi[rows] @ V
    return found


def combine(Phi: Array, V: Array) -> None:
    """Phi V in the memory of Phi (n, m), for V (m, m)."""
    for rows in row_blocks(*Phi.shape):
        Phi[rows] = Phi[rows] @ V


def side_by_side(n: int, blocks: Sequence[tuple[NDArray[np.int64] | None, Array]]) -> tuple[Array, tuple[Array, ...]]:
    """Put blocks of shapes into one basis.

    Parameters
    ----------
    n : int
        Dofs of the body.
    blocks : sequence of ((t,) int64 or None, (t, k) float64)
        Rows that the shapes are given at, and are zero beside; None for all.

    Returns
    -------
    Phi : (n, m) float64
        The basis. It is the block itself where only one of them holds shapes, and has all rows.
    views : tuple of (n, k) float64
        The blocks in it.
    """
    ends = np.cumsum([0, *(shapes.shape[1] for _, shapes in blocks)])
    filled = [block for block in blocks if block[1].shape[1]]
    if len(filled) == 1 and filled[0][0] is None:
        Phi = filled[0][1]
    else:
        Phi = new_basis(n, int(ends[-1]))
        for (rows, shapes), first in zip(blocks, ends[:-1], strict=True):
            for part in column_blocks(shapes.shape[1]):
                Phi[slice(None) if rows is None else rows, first + part.start : first + part.stop] = shapes[:, part]
    return Phi, tuple(Phi[:, first:last] for first, last in pairwise(ends))


def absolute_parts(A: sp.csc_array, Phi: Array) -> Array:
    """Absolute parts abs(phi)^T abs(A) abs(phi) that the energy of each shape is the sum of (m,)."""
    size, found = symmetric_product(abs(A)), np.empty(Phi.shape[1])
    for part in column_blocks(Phi.shape[1]):
        X = abs(Phi[:, part])
        found[part] = np.einsum("ij,ij->j", X, size(X))
    return found


def observed(C: sp.csr_array | sp.csc_array, Phi: Array) -> Array:
    """Motions C Phi (p, m) of some rows of a body in its shapes; only what C holds is read of these."""
    C = sp.csr_array(C)
    used = np.unique(C.indices)
    near = sp.csr_array(C[:, used])
    found = np.empty((C.shape[0], Phi.shape[1]))
    for part in column_blocks(Phi.shape[1]):
        found[:, part] = near @ Phi[:, part][used]
    return found


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
