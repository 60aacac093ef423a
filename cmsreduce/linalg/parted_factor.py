"""A matrix factorised part by part: exact solves and inertia with the factor of one part in memory at a time."""

from __future__ import annotations

from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.factor import BLOCK, Admit, Factor, FactorCost
from cmsreduce.linalg.layout import by_columns
from cmsreduce.linalg.partition import Partition

__all__ = ["Inner", "PartedFactor"]

# Factors of parts are kept while they take no more than this share of the memory; the rest is for the separator's and
# for one that is made again.
_KEPT = 0.5
# Memory for an entry of the separator's matrix while it is summed, of the parts that touch it: places and value twice.
_BYTES = 32.0
# A part whose weakest pivot is less than this share of its diagonal was shifted onto an eigenvalue of its own: the
# separator's matrix would keep no digits.
_HIT = 1e-9


class Inner(Protocol):
    """Factorises a block of the matrix as a whole."""

    def __call__(
        self, block: sp.csc_array, rows: NDArray[np.int64], what_of_it: str, /, *, kept: float, again: bool, last: bool
    ) -> Factor:
        """Factor of a block.

        Parameters
        ----------
        block : (k, k) csc array
            The block.
        rows : (k,) int64
            Its rows in the matrix, for messages.
        what_of_it : str
            What the block is of the matrix.
        kept : float
            Bytes that factors of other blocks hold already.
        again : bool
            Whether it was factorised before.
        last : bool
            Whether it is the separator's matrix, which tells whether the whole is singular.
        """


class PartedFactor(Factor):
    """Block L D L^T with a block for each part of a body and a last one for the rows between them.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    cut : Partition
        Its rows in parts.
    inner : callable
        Factorises a block.
    admit : callable
        Refuses a separator that is too large, before anything is factorised.
    memory : float
        Bytes that all factors may take together. Those of the parts that find no room are made again in every solve.

    Notes
    -----
    Static condensation of the parts: S = A_ss - sum A_sp A_pp^-1 A_ps is what the separator's rows keep. With it,
    A^-1 is exact, and by Sylvester's law the negative eigenvalues of A are those of all A_pp and of S. Source: J.
    Przemieniecki, "Matrix structural analysis of substructures", AIAA Journal 1 (1963) 138-147.
    """

    backend: str = "parts"

    def __init__(self, A: sp.csc_array, cut: Partition, inner: Inner, admit: Admit, memory: float) -> None:
        self.cut, self._inner, self._matrix = cut, inner, A
        self._kept: list[Factor | None] = []
        self._last: tuple[int, Factor] | None = None
        self._negative, self._known, held = 0, True, 0.0
        weakest, costs = (0, 1.0), []
        between = sp.csr_array(A[:, cut.separator].T)
        self._edges = []
        for rows in cut.interiors:
            coupling = sp.csr_array(between[:, rows])
            edge = np.flatnonzero(np.diff(coupling.indptr))
            self._edges.append((edge, coupling[edge]))
        entries = sum(edge.size**2 for edge, _ in self._edges)
        admit(FactorCost(entries, 0.0, _BYTES * entries))
        condensed = [_entries(sp.csc_array(A[cut.separator][:, cut.separator]))]
        self._shown: NDArray[np.float64] | None = np.empty(A.shape[0])
        for p, rows in enumerate(cut.interiors):
            factor = inner(self.block(p), rows, self._name(p), kept=held, again=False, last=False)
            edge, coupling = self._edges[p]
            condensed.append(_condensed(factor, coupling, edge))
            weakest = self._counted(factor, rows, factor.diagonal, weakest)
            self._known &= abs(factor.weakest[1]) > _HIT
            costs.append(factor.cost)
            keep = held + factor.cost.bytes <= _KEPT * memory
            held += factor.cost.bytes if keep else 0.0
            self._kept.append(factor if keep else None)
            self._last = (p, factor)
        # The last factor is let go where it finds no room beside the separator's.
        self._last = None
        self.S = _summed(condensed, cut.separator.size)
        del condensed, factor
        self._separator = inner(self.S, cut.separator, "the rows between its parts", kept=held, again=False, last=True)
        weakest = self._counted(self._separator, cut.separator, A.diagonal()[cut.separator], weakest)
        self._weakest = weakest
        costs.append(self._separator.cost)
        total = FactorCost(sum(c.nnz for c in costs), sum(c.flops for c in costs), 0.0)
        held, passing = self._made_room(costs, memory)
        # At its peak: what is kept, the separator's, and the largest that is not kept.
        super().__init__(A, FactorCost(total.nnz, total.flops, held + passing + self._separator.cost.bytes))

    def _made_room(self, costs: list[FactorCost], memory: float) -> tuple[float, float]:
        """Bytes of the factors kept, and of the largest that is not, after as many were let go as it takes."""
        room = memory - self._separator.cost.bytes
        for p in reversed(range(len(self._kept) + 1)):
            held, passing = (
                [cost.bytes for cost, factor in zip(costs, self._kept, strict=False) if (factor is not None) == kept]
                for kept in (True, False)
            )
            if sum(held) + max(passing, default=0.0) <= room or not p:
                break
            self._kept[p - 1] = None
        largest = max(passing, default=0.0)
        if sum(held) + largest > room:
            # Refused here, not in the midst of a solve; in single precision they may fit yet.
            largest = max(self.part(p).cost.bytes for p in range(len(self._kept)))
        return sum(held), largest

    def block(self, p: int) -> sp.csc_array:
        """Matrix of a part with the separator held (n_p, n_p)."""
        rows = self.cut.interiors[p]
        return sp.csc_array(self._matrix[rows][:, rows])

    def part(self, p: int) -> Factor:
        """Factor of a part, made again where it was not kept."""
        kept = self._kept[p]
        if kept is not None:
            return kept
        if self._last is None or self._last[0] != p:
            # The one before goes first: there is room for one.
            self._last = None
            held = sum(factor.cost.bytes for factor in self._kept if factor is not None)
            made = self._inner(
                self.block(p),
                self.cut.interiors[p],
                self._name(p),
                kept=held + self._separator.cost.bytes,
                again=True,
                last=False,
            )
            self._last = (p, made)
        return self._last[1]

    @property
    def kept(self) -> int:
        """Parts whose factors are kept."""
        return sum(factor is not None for factor in self._kept)

    def separator_solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve S x = b, (s, k)."""
        return self._separator(b)

    def extended(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Static shapes (n, k) of the whole under motions (s, k) of the separator: the parts follow without load."""
        whole = np.zeros((self.n, x.shape[1]), order="F")
        whole[self.cut.separator] = x
        for p, rows in enumerate(self.cut.interiors):
            edge, coupling = self._edges[p]
            whole[rows] = -self.part(p)(np.asarray(coupling.T @ x[edge]))
        return whole

    def __call__(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve A x = b for one column or a block: all columns in one pass over the parts, see `Factor`."""
        b = np.asarray(b, dtype=np.float64)
        if not b.size:
            return np.zeros(b.shape)
        return self._solve(b[:, None])[:, 0] if b.ndim == 1 else self._solve(b)

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        b = by_columns(b)
        load = b[self.cut.separator]
        for p, rows in enumerate(self.cut.interiors):
            edge, coupling = self._edges[p]
            load[edge] -= coupling @ self.part(p)(b[rows])
        x = np.empty(b.shape, order="F")
        between = self._separator(load)
        x[self.cut.separator] = between
        # Backwards: the last part's factor is at hand.
        for p in reversed(range(len(self.cut.interiors))):
            rows, (edge, coupling) = self.cut.interiors[p], self._edges[p]
            x[rows] = self.part(p)(b[rows] - coupling.T @ between[edge])
        return x

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,).

        Raises
        ------
        MatrixError
            If the solver of the parts does not show them.
        """
        if self._shown is None:
            raise MatrixError("the solver of the parts does not show its pivots; ask for the weakest row")
        return self._shown

    @property
    def weakest(self) -> tuple[int, float]:
        """Row of the smallest pivot ratio, and that ratio."""
        return self._weakest

    @property
    def inertia_known(self) -> bool:
        """Whether it is for every part and for the separator, and no part alone is singular."""
        return self._known

    def _negative_pivots(self) -> int:
        return self._negative

    def _name(self, p: int) -> str:
        return f"part {p + 1} of {len(self.cut.interiors)}"

    def _counted(
        self, factor: Factor, rows: NDArray[np.int64], diagonal: NDArray[np.float64], weakest: tuple[int, float]
    ) -> tuple[int, float]:
        """Take the inertia and the pivots of a block; the weakest row by then, against the matrix's own diagonal."""
        self._known &= factor.inertia_known
        self._negative += factor.negative_pivots if factor.inertia_known else 0
        try:
            shown = factor.pivots
        except MatrixError:
            self._shown = None
        else:
            if self._shown is not None:
                self._shown[rows] = shown
        row, ratio = factor.weakest
        if not rows.size or not diagonal[row]:
            return (int(rows[row]), 0.0) if rows.size else weakest
        ratio *= abs(factor.diagonal[row] / diagonal[row])
        return min(weakest, (int(rows[row]), ratio), key=lambda each: each[1])


_Entries = tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.float64]]


def _entries(A: sp.csc_array) -> _Entries:
    entries = sp.coo_array(A)
    row, column = entries.coords
    return row.astype(np.int32), column.astype(np.int32), entries.data


def _condensed(factor: Factor, coupling: sp.csr_array, edge: NDArray[np.int64]) -> _Entries:
    """Entries of -A_sp A_pp^-1 A_ps, which is full on the rows that the part touches."""
    k = edge.size
    full = np.empty((k, k))
    for first in range(0, k, BLOCK):
        columns = slice(first, first + BLOCK)
        full[:, columns] = -(coupling @ factor(coupling[columns].toarray().T))
    full = (full + full.T) / 2
    at = edge.astype(np.int32)
    return np.repeat(at, k), np.tile(at, k), full.ravel()


def _summed(entries: list[_Entries], s: int) -> sp.csc_array:
    row, column, value = (np.concatenate(each) for each in zip(*entries, strict=True))
    return sp.csc_array(sp.coo_array((value, (row, column)), shape=(s, s)))
