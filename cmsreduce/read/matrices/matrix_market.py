"""Text of one matrix entry a line, integers and then a value; Matrix Market files, which are such text.

scipy reads the header of a Matrix Market file. It does not read the entries: in a file that is cut inside a number,
scipy's reader reads past the end of the file and crashes the process.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import DOUBLE, LabelledMatrix, canonical, check_size
from cmsreduce.read.printed_numbers import real_number, rounding_of_printed, stops_in_a_number

__all__ = ["COORDINATE", "LABELLED", "MATRIX_MARKET", "read_entries"]

_ENDS = 50_000  # characters at each end of a text that show how its numbers are printed
_INTEGER = r"[+-]?\d{1,15}"  # all of them are exact as doubles
_REAL = r"(?:[+-]?(?:\d+\.?\d*|\.\d+)(?:[EeDd][+-]?\d+|[+-]\d+)?|[+-]?(?i:nan|inf(?:inity)?))"

# Sign of the triangle that is left out; real numbers are Hermitian where they are symmetric.
_MIRROR = {"general": 0.0, "symmetric": 1.0, "hermitian": 1.0, "skew-symmetric": -1.0}
# Comments and empty lines, then the sizes.
_HEAD = re.compile(r"(?:[ \t\r]*(?:%[^\n]*)?\n)*[^\n]*\n?")


@dataclass(frozen=True)
class EntryLine:
    """The grammar of a line.

    Parameters
    ----------
    words : str
        Appearance of a line, for messages.
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
        Grammar of every line.

    Raises
    ------
    ReadError
        If there are no entries, a line is no entry (with its number), or the text ends inside a number.
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
    """Values as printed on the lines at both ends of a text."""
    lines = text.strip().split("\n")
    if len(text) > 2 * _ENDS:
        lines = [*text[:_ENDS].strip().split("\n")[:-1], *text[-_ENDS:].strip().split("\n")[1:]]
    words = (line.replace(",", " ").split() for line in lines)
    return [word[width - 1] for word in words if len(word) >= width]


def _all_at_once(text: str, width: int) -> NDArray[np.float64] | None:
    """Numbers [entries, width]; None if any line must be read by ``_line_by_line``."""
    try:
        for other, usual in ("DE", "de", ", "):
            text = text.replace(other, usual)
        # loadtxt refuses a line with more or fewer numbers than the first.
        numbers = np.loadtxt(io.StringIO(text), ndmin=2, comments=None)
    except ValueError:
        return None
    where = numbers[:, :-1]
    exact = (np.abs(where) < 1e15).all() and (where == np.floor(where)).all()
    return numbers if numbers.shape[1] == width and exact else None


def _line_by_line(path: Path, text: str, line: EntryLine) -> NDArray[np.float64]:
    """Read exponents without a letter, which numpy does not know, and name the first bad line."""
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


@dataclass(frozen=True)
class _Header:
    """Contents of the first lines; ``layout`` is coordinate or array."""

    rows: int
    cols: int
    entries: int
    layout: str
    field: str
    symmetry: str


def _market_matrices(path: Path) -> list[StoredMatrix]:
    """The one matrix of a Matrix Market file.

    Parameters
    ----------
    path : Path
        Coordinate or array file; general, symmetric or skew-symmetric.

    Returns
    -------
    list of StoredMatrix
        One; loading it raises ReadError if entries are missing, out of range, or do not parse.

    Raises
    ------
    ReadError
        If the header is damaged, a size is absurd, or the file is a pattern without values.
    """
    from scipy.io import mminfo

    with reading(path, "the Matrix Market header"):
        header = _Header(*mminfo(str(path)))
    check_size(path, path.stem, header.rows, header.cols, path.stat().st_size)
    if header.field == "pattern":
        raise ReadError(f"{path}: the Matrix Market file is a pattern without values; write it with real values")
    numbers = "complex" if header.field == "complex" else f"{header.field}, as text"
    size = (header.rows, header.cols, header.entries)
    return [StoredMatrix(path.stem, numbers, header.symmetry, size, lambda: _load(path, header))]


def _load(path: Path, header: _Header) -> LabelledMatrix:
    """Read the matrix."""
    entries = read_entries(path, _body(path), COORDINATE if header.layout == "coordinate" else VALUE)
    shape = header.rows, header.cols
    n, expected = header.rows, header.entries
    if header.layout == "array":
        lengths = {"general": n * header.cols, "skew-symmetric": n * (n - 1) // 2}
        expected = lengths.get(header.symmetry, n * (n + 1) // 2)
    if entries.value.size != expected:
        raise ReadError(
            f"{path}: the Matrix Market file has {entries.value.size} entries where its header says {expected}; it is "
            "truncated or two files in one: write or copy it again"
        )
    where = entries.where - 1 if header.layout == "coordinate" else _array_places(header)
    outside = ((where < 0) | (where >= shape)).any(axis=1)
    if outside.any():
        i, j = where[outside][0] + 1
        raise ReadError(f"{path}: there is an entry at row {i}, column {j} of a {shape[0]} x {shape[1]} matrix")
    row, col = where.T
    value, sign = entries.value, _MIRROR[header.symmetry]
    if sign:
        off = row != col
        row, col = np.concatenate([row, col[off]]), np.concatenate([col, row[off]])
        value = np.concatenate([value, sign * value[off]])
    rounding = rounding_of_printed(entries.printed) if header.field in ("real", "double") else DOUBLE
    return LabelledMatrix(canonical(row, col, value, shape), path.stem, path, "matrix-market", rounding)


def _body(path: Path) -> str:
    """Text whose lines up to the sizes are empty, so that the other lines keep their numbers."""
    text = path.read_text(encoding="utf-8", errors="replace")
    head = _HEAD.match(text)
    end = head.end() if head else 0
    return "\n" * text.count("\n", 0, end) + text[end:]


def _array_places(header: _Header) -> NDArray[np.int64]:
    """Row and column of each value of an array file: column after column, of one triangle if symmetric."""
    col, row = np.divmod(np.arange(header.rows * header.cols), header.rows)
    above = {"general": -header.cols, "skew-symmetric": 1}.get(header.symmetry, 0)
    kept = row - col >= above
    return np.stack([row[kept], col[kept]], axis=1)


MATRIX_MARKET = MatrixFormat(
    "matrix-market",
    "Matrix Market",
    lambda path, head: head.decode("utf-8-sig", errors="replace").startswith("%%MatrixMarket"),
    _market_matrices,
    named=False,
)
