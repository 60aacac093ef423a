"""Modes of a body as terms of its receptance between the rows of a wiring, tabulated over frequency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SINGULAR", "Change", "Kept", "ModalTable", "ModalTerms", "add_terms"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Columns = NDArray[np.int64]
Kept = Mapping[str, Columns]
"""Elastic coordinates kept of each body; rigid and static ones are always kept, and bodies not named, whole."""
Change = tuple[str, Columns]
"""A body, and elastic coordinates of it to put in where they are left out, or to leave out where they are in."""

# Memory, in numbers, of the products of ports in one multiplication.
_PRODUCTS = 2**20
SINGULAR = 1e-10
"""A change that brings the joined flexibility this near to singular, relative to its terms, has no figure."""


@dataclass(frozen=True, eq=False)
class ModalTable:
    """A body's modes between the rows of a wiring."""

    left: Real
    right: Real
    weights: Complex
    """1/Z of every mode at every frequency (m, f)."""


@dataclass(frozen=True, eq=False)
class ModalTerms:
    """Modes that changes put in or leave out, side by side.

    Parameters
    ----------
    tables, columns : tuple
        Of each change.
    which : (k,) int64
        Number of each change among all that were asked for.
    start : (k + 1,) int64
        First mode of each change.
    sign : (modes,) float64
        1 put in, -1 left out.
    left, right : (ports, modes) float64
    """

    tables: tuple[ModalTable, ...]
    columns: tuple[Columns, ...]
    which: NDArray[np.int64]
    start: NDArray[np.int64]
    sign: Real
    left: Real
    right: Real

    @classmethod
    def of(
        cls, tables: Mapping[str, ModalTable], changes: Sequence[Change], which: NDArray[np.int64], kept: Kept
    ) -> ModalTerms:
        """Lay those changes side by side that ``which`` numbers."""
        chosen = [changes[k] for k in which]
        sizes = [columns.size for _, columns in chosen]
        signs = [-1.0 if body not in kept or np.isin(columns, kept[body]).all() else 1.0 for body, columns in chosen]
        found, columns = tuple(tables[body] for body, _ in chosen), tuple(columns for _, columns in chosen)
        ports = next(((t.left.shape[0], t.right.shape[0]) for t in tables.values()), (0, 0))
        left, right = (
            np.hstack([np.zeros((rows, 0)), *(getattr(t, side)[:, own] for t, own in zip(found, columns, strict=True))])
            for side, rows in zip(("left", "right"), ports, strict=True)
        )
        start = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
        return cls(found, columns, which, start, np.repeat(signs, sizes), left, right)

    def weights(self, points: NDArray[np.int64]) -> Complex:
        """Signed 1/Z of every mode at some frequencies (g, modes)."""
        out = np.empty((points.size, self.sign.size), dtype=np.complex128)
        for table, columns, start in zip(self.tables, self.columns, self.start[:-1], strict=True):
            own = slice(start, start + columns.size)
            out[:, own] = table.weights[np.ix_(columns, points)].T
        return out * self.sign

    def update(
        self,
        dH: Complex,
        known: NDArray[np.bool_],
        part: slice,
        Z: Complex,
        alpha: Real,
        Sv: Complex,
        P: Complex,
        Q: Complex,
    ) -> None:
        """Set what each change adds to the response at a block of frequencies."""
        sizes = np.diff(self.start)
        alone = self.start[:-1][sizes == 1]
        W = np.einsum("ck,fck->fk", alpha[:, alone], Sv[:, :, alone])
        pivot = Z[:, alone] + W
        regular = np.all(abs(pivot) > SINGULAR * (abs(Z[:, alone]) + abs(W)), axis=0)
        number = self.which[sizes == 1]
        known[number[~regular]] = False
        good = alone[regular]
        dH[part, :, :, number[regular]] = P[:, :, None, good] * (Q[:, None, :, good] / pivot[:, None, None, regular])
        for k in np.flatnonzero(sizes > 1):
            own = slice(self.start[k], self.start[k + 1])
            W = alpha[:, own].T @ Sv[:, :, own]
            pivots = W + Z[:, :, None][:, own] * np.eye(sizes[k])
            if np.linalg.cond(pivots).max() * SINGULAR > 1:
                known[self.which[k]] = False
            else:
                dH[part, :, :, self.which[k]] = P[:, :, own] @ np.linalg.solve(pivots, Q[:, :, own].transpose(0, 2, 1))


def add_terms(G: Complex, table: ModalTable, columns: Columns, points: NDArray[np.int64] | None = None) -> None:
    """Add the terms of some modes to an array, in products of real matrices over all frequencies.

    Parameters
    ----------
    G : (left, right, f) complex128
        Changed in place.
    table : ModalTable
    columns : (k,) int64
    points : (f,) int64, optional
        Which of the table's frequencies, all of them if left out.
    """
    # A joint elsewhere, or a sensor of another body, has rows of nothing but zeros here.
    rows, ports = (np.flatnonzero(side[:, columns].any(axis=1)) for side in (table.left, table.right))
    if not (rows.size and ports.size and G.size):
        return
    weights = table.weights[columns] if points is None else table.weights[np.ix_(columns, points)]
    right = table.right[np.ix_(ports, columns)]
    step = max(1, _PRODUCTS // right.size)
    for start in range(0, rows.size, step):
        own = rows[start : start + step]
        products = (table.left[np.ix_(own, columns)][:, None, :] * right).reshape(-1, columns.size)
        found = (products @ weights.view(np.float64)).view(np.complex128)
        G[np.ix_(own, ports)] += found.reshape(own.size, ports.size, -1)
