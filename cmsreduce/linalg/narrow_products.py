"""Products of a dense block with few right-hand sides at the speed of memory: the block is read once, never copied."""

from __future__ import annotations

from typing import Any, NamedTuple

from numpy.typing import NDArray

from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.register_kernels import (
    COLUMNS,
    NARROW,
    WIDE,
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
        Array that the block lies in by columns.
    at : int
        Where its first entry lies.
    height : int
        Entries from a column to the next.
    columns, rows : int
        Of the block.
    """

    values: NDArray[Any]
    at: int
    height: int
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
    q = 0
    while q < k:
        wide = q + WIDE <= k
        for j in range(0, part.columns, COLUMNS):
            at, left = part.at + j * part.height, min(COLUMNS, part.columns - j)
            if wide:
                subtract_wide(part.values, at, part.height, left, X, x + j * k + q, Y, y + q, part.rows, k)
            else:
                subtract_narrow(part.values, at, part.height, left, X, x + j * k + q, Y, y + q, part.rows, k)
        q += WIDE if wide else NARROW


@loop
def subtract_transposed(part: Part, X: NDArray[Any], x: int, Y: NDArray[Any], y: int, k: int) -> None:
    """X = X - A^T Y; the rows that X has to spare are spoilt."""
    q = 0
    while q < k:
        wide = q + WIDE <= k
        for j in range(0, part.columns, COLUMNS):
            at, left = part.at + j * part.height, min(COLUMNS, part.columns - j)
            if wide:
                transposed_wide(part.values, at, part.height, left, X, x + j * k + q, Y, y + q, part.rows, k)
            else:
                transposed_narrow(part.values, at, part.height, left, X, x + j * k + q, Y, y + q, part.rows, k)
        q += WIDE if wide else NARROW
