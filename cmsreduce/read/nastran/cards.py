"""One NASTRAN bulk data entry, and the cards of a file."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import ReadError

__all__ = ["FIELDS_PER_LINE", "Card", "CardFile", "real_number"]

FIELDS_PER_LINE = 8
"""Data fields on one line of a card with fields of eight characters."""

_INTEGER = re.compile(r"[+-]?\d+\Z")
_REAL = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+))(?:[ED]?([+-]?\d+))?\Z")


def real_number(text: str) -> float | None:
    """Value of a NASTRAN real, None if the text is no number.

    Examples
    --------
    >>> real_number("1.5-3"), real_number("1.+7"), real_number("-.25d2"), real_number("THRU")
    (0.0015, 10000000.0, -25.0, None)
    """
    found = _REAL.match(text.strip().upper())
    return None if found is None else float(f"{found[1]}E{found[2] or 0}")


@dataclass(frozen=True, slots=True)
class Card:
    """One bulk data entry.

    Parameters
    ----------
    name : str
        Upper case, without the asterisk of wide fields.
    fields : tuple of str
        Data fields in upper case, continuation lines run on, eight to a line: ``fields[0]`` is field 2 of the
        manual, ``fields[8]`` the first data field of the second line.
    path : Path
        File it stands in.
    line : int
        Line it starts on, from 1.
    """

    name: str
    fields: tuple[str, ...]
    path: Path
    line: int

    @property
    def where(self) -> str:
        """File, line and name, for messages."""
        return f"{self.path}, line {self.line}: {self.name}"

    def text(self, index: int) -> str:
        """Field as text, empty where the card is shorter."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, index: int, default: int | None = None) -> int:
        """Field as an integer.

        Raises
        ------
        ReadError
            If it is no integer, or blank with no default.
        """
        text = self.text(index)
        if not text and default is not None:
            return default
        if not _INTEGER.match(text):
            raise ReadError(f"{self.where}: {_field(index)} should be an integer, it is '{text}'")
        return int(text)

    def real(self, index: int, default: float = 0.0) -> float:
        """Field as a real number.

        Raises
        ------
        ReadError
            If it is no number.
        """
        text = self.text(index)
        if not text:
            return default
        value = real_number(text)
        if value is None:
            raise ReadError(f"{self.where}: {_field(index)} should be a number, it is '{text}'")
        return value


def _field(index: int) -> str:
    """Name of a field as the manual counts them, with its line where that is not the first."""
    line, column = divmod(index, FIELDS_PER_LINE)
    return f"field {column + 2}" + ("" if line == 0 else f" of line {line + 1} of the card")


@dataclass(frozen=True)
class CardFile:
    """The cards of an input file and of the files it includes.

    Parameters
    ----------
    path : Path
        The file named by the user.
    case_control : tuple of str, optional
        Case control lines in upper case; None if the file is bulk data only.
    sections : mapping of superelement number to mapping of card name to tuple of Card
        Bulk data: 0 is the main part, others stand after BEGIN SUPER.
    files : tuple of Path
        Every file read, the first is ``path``.
    """

    path: Path
    case_control: tuple[str, ...] | None
    sections: Mapping[int, Mapping[str, tuple[Card, ...]]]
    files: tuple[Path, ...]
