"""Products of a dense block with few right-hand sides at the speed of memory: the block is read once, never copied."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.register_kernels import (
    COLUMNS,
    NARROW,
    WIDE,
    row_subtract_narrow,
    row_subtract_wide,
    row_transposed_narrow,
    row_transposed_wide,
    subtract_narrow,
    subtract_wide,
    transposed_narrow,
    transposed_wide,
)

__all__ = ["AT_ONCE", "SPARE", "Part", "padded", "subtract", "subtract_transposed"]

AT_ONCE = 256
"""Rows of a block that are best worked on at a time: their right-hand sides stay at hand, and the block's entries."""

SPARE = COLUMNS
"""Rows that X needs beyond those that a block has columns."""


class Part(NamedTuple):
    """A dense block.

    Parameters
    ----------
    values : (e,) float64 or float32
        Array that the block lies in.
    at : int
        Where its first entry lies.
    across, down : int
        Entries from a column to the next, and from a row to the next: one of them is 1.
    columns, rows : int
        Of the block.
    """

    values: NDArray[Any]
    at: int
    across: int
    down: int
    columns: int
    rows: int


def padded(k: int) -> int:
    """Entries of a row for k right-hand sides: those of the kernels."""
    return -(-k // NARROW) * NARROW


@loop
def subtract(part: Part, X: NDArray[Any], x: int, Y: NDArray[Any], y: int, k: int) -> None:
    """Y = Y - A X for a block A; X and Y are rows of k entries that begin at places of arrays.

    k is one of `padded`; X has `SPARE` rows more than the block has columns, of zeros if it has rows.
    """
    A, rows, q = part.values, part.rows, 0
    while q < k:
        wide = q + WIDE <= k
        for j in range(0, part.columns, COLUMNS):
            a, b, c = part.at + j * part.across, x + j * k + q, y + q
            left = min(COLUMNS, part.columns - j)
            if part.down == 1:
                if wide:
                    subtract_wide(A, a, part.across, left, X, b, Y, c, rows, k)
                else:
                    subtract_narrow(A, a, part.across, left, X, b, Y, c, rows, k)
            elif wide:
                row_subtract_wide(A, a, part.down, left, X, b, Y, c, rows, k)
            else:
                row_subtract_narrow(A, a, part.down, left, X, b, Y, c, rows, k)
        q += WIDE if wide else NARROW


@loop
def subtract_transposed(part: Part, X: NDArray[Any], x: int, Y: NDArray[Any], y: int, k: int) -> None:
    """X = X - A^T Y; the rows that X has to spare are spoilt."""
    A, rows, q = part.values, part.rows, 0
    while q < k:
        wide = q + WIDE <= k
        for j in range(0, part.columns, COLUMNS):
            a, b, c = part.at + j * part.across, x + j * k + q, y + q
            left = min(COLUMNS, part.columns - j)
            if part.down == 1:
                if wide:
                    transposed_wide(A, a, part.across, left, X, b, Y, c, rows, k)
                else:
                    transposed_narrow(A, a, part.across, left, X, b, Y, c, rows, k)
            elif wide:
                row_transposed_wide(A, a, part.down, left, X, b, Y, c, rows, k)
            else:
                row_transposed_narrow(A, a, part.down, left, X, b, Y, c, rows, k)
        q += WIDE if wide else NARROW
