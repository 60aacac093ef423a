"""One card of a NASTRAN input file, and its fields as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.cards.open_card import FIELDS_PER_LINE
from cmsreduce.read.printed_numbers import INTEGER, real_number, whole_number

__all__ = ["INTEGER", "LARGEST", "Card"]

LARGEST = 1e60
"""Products of a few numbers below it stay finite; NASTRAN itself ends at 1e38 or 1e308."""

_SHOWN = 40  # characters of a bad field in a message


@dataclass(frozen=True, slots=True)
class Card:
    """One bulk data entry.

    Parameters
    ----------
    name : str
        Upper case, without the asterisk of wide fields.
    fields : tuple of str
        Data fields of all lines in upper case, eight to a line: ``fields[0]`` is field 2 of the manual, ``fields[8]``
        the first data field of the second line.
    path : Path
        File of the card.
    line : int
        First line of the card, from 1.
    """

    name: str
    fields: tuple[str, ...]
    path: Path
    line: int

    @property
    def where(self) -> str:
        """File, line and name, for messages."""
        return f"{self.path}, line {self.line}: {self.name}"

    def with_fields(self, fields: Sequence[str]) -> Card:
        """Card with other fields and the same place in the file."""
        return Card(self.name, tuple(fields), self.path, self.line)

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
        if not INTEGER.match(text):
            raise ReadError(f"{self.where}: {_field(index)} should be an integer, it is '{text[:_SHOWN]}'")
        return int(text)

    def whole_numbers(self, start: int = 0) -> list[int]:
        """Whole numbers among the fields from one on; other text is passed over."""
        numbers = (whole_number(text) for text in self.fields[start:])
        return [number for number in numbers if number is not None]

    def real(self, index: int, default: float = 0.0) -> float:
        """Field as a real number.

        Raises
        ------
        ReadError
            If it is no number, or of an impossible size.
        """
        text = self.text(index)
        if not text:
            return default
        value = real_number(text)
        if value is None:
            raise ReadError(f"{self.where}: {_field(index)} should be a number, it is '{text[:_SHOWN]}'")
        if not abs(value) < LARGEST:
            raise ReadError(
                f"{self.where}: {_field(index)} is '{text[:_SHOWN]}', more than any length, mass or stiffness; "
                "the deck is damaged: write it again"
            )
        return value


def _field(index: int) -> str:
    """Name of a field as the manual counts, with its line unless that is the first."""
    line, column = divmod(index, FIELDS_PER_LINE)
    return f"field {column + 2}" + ("" if line == 0 else f" of line {line + 1} of the card")
