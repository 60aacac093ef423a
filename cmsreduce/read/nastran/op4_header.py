"""Header of one matrix of a NASTRAN OUTPUT4 file, binary or printed."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["ROWS_FOR_BIGMAT", "TYPES", "Op4Header"]

TYPES = {1: "real single", 2: "real double", 3: "complex single", 4: "complex double"}
"""Types of numbers by NASTRAN's code."""

ROWS_FOR_BIGMAT = 65536
"""From this number of rows on, row numbers do not share a word with lengths of strings."""


@dataclass(frozen=True)
class Op4Header:
    """Header of one matrix.

    Parameters
    ----------
    name : str
        As in the file; empty where it has none.
    rows, cols : int
        Size.
    form, type : int
        NASTRAN codes.
    rounding : float
        Relative rounding of the numbers.
    ascii : bool
        True if numbers are printed.
    start : int
        Byte, or line, after which its columns start.
    number : str
        Type of a number in memory (numpy).
    width : int
        Characters of a printed number.
    per_line : int
        Printed numbers on a line.
    bigmat : bool
        True if row numbers and lengths of strings have separate words.
    """

    name: str
    rows: int
    cols: int
    form: int
    type: int
    rounding: float
    ascii: bool
    start: int
    number: str = "f8"
    width: int = 0
    per_line: int = 0
    bigmat: bool = False

    @property
    def words_each(self) -> int:
        """Words of 32 bits of a number; lengths of strings are counted in such words."""
        return 1 if self.type in (1, 3) else 2

    @property
    def parts(self) -> int:
        """Real numbers of an entry: a complex one has two."""
        return 2 if self.type in (3, 4) else 1
