"""Receptances that are also formed between some rows alone, and modes between the rows that they move."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FEWER", "MANY", "ByRows", "ModalTable", "RowTerms", "add_between", "frequencies_last", "products"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Columns = NDArray[np.int64]

FEWER = 4
"""The part of a receptance between joints, inputs and outputs is formed alone if it has so many times fewer entries."""
MANY = 48
"""For the motions of fewer points, either takes no time."""
# Most entries in the products of rows in one multiplication.
_PRODUCTS = 2**20


class ByRows(ABC):
    """Receptance of a body over its motions, or between some rows of them alone."""

    @property
    @abstractmethod
    def motions(self) -> int:
        """Number of motions."""

    @abstractmethod
    def __call__(self, omega: Real) -> Complex:
        """Receptances (f, p, p) at frequencies (f,) in rad/s.

        Raises
        ------
        MatrixError
            If a frequency hits a mode without damping.
        """

    @abstractmethod
    def add(self, G: Complex, left: Real, right: Real, omega: Real, loads: Complex | None = None) -> None:
        """Add left Y right^T to an array, or left Y right^T loads.

        Parameters
        ----------
        G : (l, r, f) or (l, i, f) complex128
            Changed in place.
        left, right : (l, p), (r, p) float64
        omega : (f,) float64
            Circular frequencies in rad/s.
        loads : (r, i, f) complex128, optional
            Contiguous forces at the rows on the right: few where the joints are known.

        Raises
        ------
        MatrixError
            If a frequency hits a mode without damping.
        """

    def has_fewer(self, sides: Iterable[tuple[Real, Real]]) -> bool:
        """True if some pairs of rows (l, p) and (r, p) have far fewer entries between them than the whole receptance.

        So it is with many sensors: only joints and inputs exert forces.
        """
        pairs = sum(np.count_nonzero(a.any(axis=1)) * np.count_nonzero(b.any(axis=1)) for a, b in sides)
        return bool(self.motions >= MANY and FEWER * pairs <= self.motions**2)


def products(A: Real, X: Complex) -> Complex:
    """A X of a real matrix (a, b) and a contiguous array (b, i, f), in real arithmetic."""
    found = A @ X.reshape(len(X), -1).view(np.float64)
    return np.asarray(found.view(np.complex128).reshape(len(A), *X.shape[1:]))


def add_between(G: Complex, left: Real, Y: Complex, right: Real, loads: Complex | None = None) -> None:
    """Add left Y right^T, or left Y right^T loads, to an array, in products of real matrices over all frequencies.

    Parameters
    ----------
    G : (l, r, f) or (l, i, f) complex128
        Changed in place.
    left, right : (l, p), (r, p) float64
    Y : (p, p, f) complex128
        Contiguous: one body's receptance, frequencies last.
    loads : (r, i, f) complex128, optional
    """
    if loads is not None:
        between = np.zeros((left.shape[0], right.shape[0], Y.shape[2]), dtype=np.complex128)
        add_between(between, left, Y, right)
        G += np.einsum("lrf,rif->lif", between, loads)
        return
    # Joints and sensors of other bodies have zero rows here.
    rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
    if not (rows.size and columns.size and Y.size):
        return
    # With many sensors, most motions are measured and few are loaded.
    moved, loaded = (np.flatnonzero(side.any(axis=0)) for side in (left, right))
    if FEWER * moved.size * loaded.size <= Y.shape[0] * Y.shape[1]:
        left, right, Y = left[:, moved], right[:, loaded], Y[np.ix_(moved, loaded)]
    p, q, f = Y.shape
    half = (left[rows] @ Y.view(np.float64).reshape(p, -1)).reshape(rows.size, q, 2 * f)
    both = right[columns] @ half
    # Selected rows and columns would be copied before and after the sum.
    if both.size == 2 * G.size:
        G.view(np.float64)[...] += both
    else:
        G[np.ix_(rows, columns)] += both.view(np.complex128)


def frequencies_last(Y: Complex) -> Complex:
    """Reorder a receptance (f, p, p) to (p, p, f), contiguous; that of a body in modes is not copied."""
    return np.ascontiguousarray(Y.transpose(1, 2, 0))


@dataclass(frozen=True, eq=False)
class ModalTable:
    """A body's modes between the rows of a wiring."""

    left: Real
    right: Real
    weights: Complex
    """1/Z of every mode at every frequency (m, f)."""


@dataclass(frozen=True, eq=False)
class RowTerms:
    """Some modes of a body between the rows that they move; joints and sensors of other bodies have zero rows.

    Parameters
    ----------
    rows, ports : (r,), (p,) int64
        Rows of the left and of the right side that move.
    left, right : (r, k), (p, k) float64
        Their motions in each mode.
    weights : (k, f) complex128
        1/Z of each mode.
    """

    rows: Columns
    ports: Columns
    left: Real
    right: Real
    weights: Complex

    @classmethod
    def of(cls, table: ModalTable, columns: Columns) -> RowTerms:
        """Modes ``columns`` of a body."""
        rows, ports = (np.flatnonzero(side[:, columns].any(axis=1)) for side in (table.left, table.right))
        left, right = table.left[np.ix_(rows, columns)], table.right[np.ix_(ports, columns)]
        return cls(rows, ports, left, right, table.weights[columns])

    def add(self, G: Complex, points: Columns | slice = slice(None)) -> None:
        """Add the terms to an array, in products of real matrices over all frequencies.

        Parameters
        ----------
        G : (left, right, f) complex128
            Changed in place.
        points : (f,) int64 or slice
            Numbers of the frequencies.
        """
        if not (self.left.size and self.right.size and G.size):
            return
        # A slice is copied much faster than the same frequencies one by one.
        weights = np.ascontiguousarray(self.weights[:, points]).view(np.float64)
        step = max(1, _PRODUCTS // self.right.size)
        for start in range(0, self.rows.size, step):
            own = slice(start, start + step)
            products = (self.left[own, None, :] * self.right).reshape(-1, self.left.shape[1])
            found = (products @ weights).view(np.complex128)
            G[np.ix_(self.rows[own], self.ports)] += found.reshape(-1, self.ports.size, G.shape[-1])
