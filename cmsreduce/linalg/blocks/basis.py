"""Bases of shapes in memory or on disk: new bases, combinations of their columns, and products block by block.

A basis (n, m) is stored by columns, the columns of a search for modes (`SearchSpace`) by rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks.products import absolute_product, column_blocks
from cmsreduce.linalg.blocks.tall_blocks import by_rows, combination, inner_of_all, less_all
from cmsreduce.linalg.machine import current_settings
from cmsreduce.model import mapped_array, mapped_in, shapes_beside

__all__ = [
    "SearchSpace",
    "absolute_parts",
    "combine",
    "combined",
    "new_basis",
    "observed",
    "outgrows",
    "row_blocks",
    "side_by_side",
    "skew_congruence",
]

Array = NDArray[np.float64]

# Values in a block of rows, 8 MiB: far less than a block of columns, and still long runs of each column on disk.
_VALUES = 2**20
# A search may take the memory of three bases: only one search runs at a time.
_SEARCH_BASES = 3
# Rows of a search that are combined at a time.
_SEARCH_ROWS = 4096


def outgrows(n: int, m: int) -> bool:
    """True if a basis (n, m) goes to disk: `SolverSettings` name a folder, and it exceeds their ``basis_limit``."""
    settings = current_settings()
    return settings.scratch is not None and np.dtype(np.float64).itemsize * n * m > settings.basis_limit


def new_basis(n: int, m: int) -> Array:
    """Zero basis (n, m) in Fortran order, in memory or on disk (`outgrows`)."""
    folder = current_settings().scratch
    if folder is None or not outgrows(n, m):
        return np.zeros((n, m), order="F")
    return mapped_array(folder, n, m)


def row_blocks(n: int, m: int) -> Iterator[slice]:
    """Rows of a basis (n, m) in blocks of 8 MiB."""
    height = max(_VALUES // max(m, 1), 1)
    return (slice(first, min(first + height, n)) for first in range(0, n, height))


def skew_congruence(G: Array | sp.csc_array, Phi: Array) -> Array:
    """Phi^T G Phi (m, m) of a skew matrix (n, n) that acts on few rows, as that of wheels, and shapes Phi (n, m)."""
    skew = sp.csc_array(G)
    rows = np.unique(skew.indices)
    part, found = sp.csr_array(skew[rows][:, rows]), np.zeros((Phi.shape[1], Phi.shape[1]))
    for block in row_blocks(rows.size, Phi.shape[1]):
        found += Phi[rows[block]].T @ (part[block] @ Phi[rows])
    return found


def combined(Phi: Array, V: Array) -> Array:
    """New shapes Phi V (n, k) of shapes (n, m), for V (m, k); on disk if Phi is, or if they outgrow memory."""
    n, k = Phi.shape[0], V.shape[1]
    shapes = new_basis(n, k) if mapped_in(Phi) is None else shapes_beside(Phi, k)
    for rows in row_blocks(n, max(Phi.shape[1], k)):
        shapes[rows] = Phi[rows] @ V
    return shapes


def combine(Phi: Array, V: Array) -> None:
    """Replace the shapes Phi (n, m) by Phi V, for V (m, m), in the memory of Phi."""
    for rows in row_blocks(*Phi.shape):
        Phi[rows] = Phi[rows] @ V


def side_by_side(n: int, blocks: Sequence[tuple[NDArray[np.int64] | None, Array]]) -> tuple[Array, tuple[Array, ...]]:
    """Put blocks of shapes into one basis.

    Parameters
    ----------
    n : int
        Dofs of the body.
    blocks : sequence of ((t,) int64 or None, (t, k) float64)
        Rows of the body at which the shapes are given, None for all rows, and the shapes; they are zero elsewhere.

    Returns
    -------
    Phi : (n, m) float64
        The basis. It is the block itself if only one block holds shapes and has all rows.
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
    """Sums abs(phi)^T abs(A) abs(phi) (m,): the scale of the rounding error in the energy of each shape."""
    product, sums = absolute_product(A), np.empty(Phi.shape[1])
    for part in column_blocks(Phi.shape[1]):
        X = abs(Phi[:, part])
        sums[part] = np.einsum("ij,ij->j", X, product(X))
    return sums


def observed(C: sp.csr_array | sp.csc_array, Phi: Array) -> Array:
    """Motions C Phi (p, m) of a few observed rows; only the rows of Phi that C uses are read."""
    C = sp.csr_array(C)
    used = np.unique(C.indices)
    C_used = sp.csr_array(C[:, used])
    motions = np.empty((C.shape[0], Phi.shape[1]))
    for part in column_blocks(Phi.shape[1]):
        motions[:, part] = C_used @ Phi[:, part][used]
    return motions


class SearchSpace:
    """Orthonormal columns V (n, m) of a search, which grows by blocks; each block is stored by rows.

    Products read a block as a whole, which is quicker by rows. Blocks that do not fit in memory are on disk.

    Parameters
    ----------
    n : int
        Rows.
    """

    def __init__(self, n: int) -> None:
        self.n = n
        self._blocks: list[Array] = []
        # Number of columns that are known to fit in memory.
        self._fitting = 0

    @property
    def m(self) -> int:
        """Number of columns."""
        return sum(block.shape[1] for block in self._blocks)

    def append(self, X: Array) -> Array:
        """Add columns (n, k) and return them as they are stored: possibly X itself, which must not change any more."""
        k = X.shape[1]
        if not k:
            return by_rows(X)
        wanted = self.m + k
        if wanted > self._fitting and not self._outgrows(2 * wanted):
            # Reading the free memory takes as long as a product with all columns: it is done when columns double.
            self._fitting = 2 * wanted
        folder = current_settings().scratch
        if wanted <= self._fitting or folder is None or not self._outgrows(wanted):
            block = by_rows(X)
        else:
            block = mapped_array(folder, self.n, k, by_rows=True)
            for rows in row_blocks(self.n, k):
                block[rows] = X[rows]
        self._blocks.append(block)
        return block

    def _outgrows(self, m: int) -> bool:
        """True if a search over m columns does not fit in memory."""
        return outgrows(self.n, m // _SEARCH_BASES)

    def inner(self, W: Array) -> Array:
        """Inner products V^T W (m, k)."""
        return inner_of_all(self._blocks, W)

    def taken_from(self, W: Array, c: Array) -> Array:
        """Difference W - V c in the memory of W, (n, k) by columns or by rows."""
        return less_all(W, self._blocks, c)

    def combined(self, S: Array, *beside: Array) -> Array:
        """Combinations V S (n, k) in Fortran order, or [V, X] S with further columns X in ``beside``."""
        blocks = [*self._blocks, *beside]
        return combination(blocks, S) if blocks else np.zeros((self.n, S.shape[1]), order="F")

    def shrink(self, S: Array) -> None:
        """Replace the columns by V S, for S (m, k) with k <= m."""
        before, k = self._blocks, S.shape[1]
        starts = np.cumsum([0, *(block.shape[1] for block in before)]).tolist()
        self._blocks = [block[:, : k - start] for block, start in zip(before, starts, strict=False) if start < k]
        for first in range(0, self.n, _SEARCH_ROWS):
            rows = slice(first, first + _SEARCH_ROWS)
            columns = np.hstack([block[rows] for block in before]) @ S
            for block, start in zip(self._blocks, starts, strict=False):
                block[rows] = columns[:, start : start + block.shape[1]]
