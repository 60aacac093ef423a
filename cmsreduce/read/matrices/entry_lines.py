"""Text of one matrix entry a line: integers that say where it stands, then its value."""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran import real_number
from cmsreduce.read.printed_numbers import stops_in_a_number

__all__ = ["COORDINATE", "LABELLED", "VALUE", "Entries", "EntryLine", "read_entries"]

_SAMPLE = 50_000  # characters at either end of a text in which the way its numbers are printed is looked at
_INTEGER = r"[+-]?\d{1,15}"  # all of them are exact as doubles
_REAL = r"(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+|[+-]\d+)?|[+-]?(?i:nan|inf(?:inity)?))"


@dataclass(frozen=True)
class EntryLine:
    """The grammar of a line.

    Parameters
    ----------
    words : str
        What it looks like, for messages.
    integers : int
        Integers before the value.
    pattern : re.Pattern
        Matches a whole line.
    """

    words: str
    integers: int
    pattern: re.Pattern[str]

    def matches(self, line: str) -> bool:
        """Whether a line is an entry."""
        return self.pattern.fullmatch(line) is not None


COORDINATE = EntryLine("i j value", 2, re.compile(rf"\s*{_INTEGER}[\s,]+{_INTEGER}[\s,]+{_REAL}[\s,]*"))
LABELLED = EntryLine("node,dof, node,dof, value", 4, re.compile(rf"\s*(?:{_INTEGER}\s*,\s*){{4}}{_REAL}[\s,]*"))
VALUE = EntryLine("value", 0, re.compile(rf"\s*{_REAL}\s*"))


@dataclass(frozen=True, eq=False)
class Entries:
    """Entries of a text.

    Parameters
    ----------
    where : (entries, integers) int64
        Integers before each value.
    value : (entries,) float64
        Values.
    printed : list of str
        Values as printed; of a long text, those of its first and last lines.
    """

    where: NDArray[np.int64]
    value: NDArray[np.float64]
    printed: list[str]


def read_entries(path: Path, text: str, line: EntryLine) -> Entries:
    """Read all entries of a text.

    Parameters
    ----------
    path : Path
        File of the text, for messages.
    text : str
        Lines of entries; empty lines are skipped.
    line : EntryLine
        What every line must be.

    Raises
    ------
    ReadError
        If there are no entries, a line is none (with its number), or the text ends inside a number.
    """
    printed = _printed_values(text, line.integers + 1)
    if not printed:
        raise ReadError(f"{path}: there are no entries '{line.words}' in it")
    numbers = _all_at_once(text, line.integers + 1)
    if numbers is None:
        numbers = _line_by_line(path, text, line)
    if not text.endswith("\n") and stops_in_a_number(printed):
        raise ReadError(
            f"{path}: the file ends inside its last number, '{printed[-1]}'; it is truncated: write or copy it again"
        )
    return Entries(numbers[:, :-1].astype(np.int64), numbers[:, -1], printed)


def _printed_values(text: str, width: int) -> list[str]:
    """Values as printed on the lines at either end of a text."""
    lines = text.strip().split("\n")
    if len(text) > 2 * _SAMPLE:
        lines = [*text[:_SAMPLE].strip().split("\n")[:-1], *text[-_SAMPLE:].strip().split("\n")[1:]]
    words = (line.replace(",", " ").split() for line in lines)
    return [word[width - 1] for word in words if len(word) >= width]


def _all_at_once(text: str, width: int) -> NDArray[np.float64] | None:
    """Numbers [entries, width], None if any line needs a closer look."""
    try:
        for other, usual in ("DE", "de", ", "):
            text = text.replace(other, usual)
        # It refuses a line with more or fewer numbers than the first.
        numbers = np.loadtxt(io.StringIO(text), ndmin=2, comments=None)
    except ValueError:
        return None
    where = numbers[:, :-1]
    exact = (np.abs(where) < 1e15).all() and (where == np.floor(where)).all()
    return numbers if numbers.shape[1] == width and exact else None


def _line_by_line(path: Path, text: str, line: EntryLine) -> NDArray[np.float64]:
    """Read with care what could not be read at once: exponents without a letter pass, the first bad line is named."""
    rows: list[list[float]] = []
    lines = text.split("\n")
    for number, found in enumerate(lines, start=1):
        if not found.strip():
            continue
        if not line.matches(found):
            cut = " (the last of the file, so it is probably truncated)" if number == len(lines) else ""
            raise ReadError(
                f"{path}, line {number}{cut}: '{found.strip()[:60]}' is not an entry '{line.words}' of real numbers"
            )
        *where, value = found.replace(",", " ").split()
        real = real_number(value)
        rows.append([*map(float, where), float(value) if real is None else real])
    return np.array(rows, dtype=np.float64)
