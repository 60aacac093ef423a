"""Text with one matrix entry a line, integers and then a value; Matrix Market files, which have such lines.

scipy reads the header of a Matrix Market file, but not the entries: if a file is cut inside a number, scipy's reader
reads past the end of the file and crashes the process.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass
from functools import partial
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
        """True if a line is an entry."""
        return self.pattern.fullmatch(line) is not None


COORDINATE = EntryLine("i j value", 2, re.compile(rf"\s*{_INTEGER}[\s,]+{_INTEGER}[\s,]+{_REAL}[\s,]*"))
LABELLED = EntryLine("node,dof, node,dof, value", 4, re.compile(rf"\s*(?:{_INTEGER}\s*,\s*){{4}}{_REAL}[\s,]*"))
VALUE = EntryLine("value", 0, re.compile(rf"\s*{_REAL}\s*"))


def read_entries(path: Path, text: str, line: EntryLine) -> tuple[NDArray[np.int64], NDArray[np.float64], list[str]]:
    """Read all entries of a text.

    Parameters
    ----------
    path : Path
        File of the text, for messages.
    text : str
        Lines of entries; empty lines are skipped.
    line : EntryLine
        Grammar of every line.

    Returns
    -------
    where : (entries, integers) int64
        Integers before each value.
    value : (entries,) float64
        Values.
    printed : list of str
        Values as printed; only the first and the last ones of a long text.

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
    return numbers[:, :-1].astype(np.int64), numbers[:, -1], printed


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


def _market_matrices(path: Path) -> list[StoredMatrix]:
    """The one matrix of a Matrix Market file: coordinate or array; general, symmetric or skew-symmetric.

    Raises
    ------
    ReadError
        If the header is damaged, a size is absurd, or the file is a pattern without values. Loading raises it if
        entries are missing, out of range, or do not parse.
    """
    from scipy.io import mminfo

    with reading(path, "the Matrix Market header"):
        rows, cols, count, layout, field, symmetry = mminfo(str(path))
    check_size(path, path.stem, rows, cols, path.stat().st_size)
    if field == "pattern":
        raise ReadError(f"{path}: the Matrix Market file is a pattern without values; write it with real values")
    numbers = "complex" if field == "complex" else f"{field}, as text"
    lengths = {"general": rows * cols, "skew-symmetric": rows * (rows - 1) // 2}
    # An array file lists values without their places.
    array = lengths.get(symmetry, rows * (rows + 1) // 2) if layout == "array" else None
    load = partial(_load, path, (rows, cols), count, array, symmetry, field in ("real", "double"))
    return [StoredMatrix(path.stem, numbers, symmetry, (rows, cols, count), load)]


def _load(
    path: Path, shape: tuple[int, int], count: int, array: int | None, symmetry: str, rounded: bool
) -> LabelledMatrix:
    """Read the matrix: ``count`` entries with their places, or ``array`` values without places."""
    text = path.read_text(encoding="utf-8", errors="replace")
    head = _HEAD.match(text)
    end = head.end() if head else 0
    # Lines up to the sizes become empty, so that the other lines keep their numbers.
    body = "\n" * text.count("\n", 0, end) + text[end:]
    where, value, printed = read_entries(path, body, COORDINATE if array is None else VALUE)
    expected = count if array is None else array
    if value.size != expected:
        raise ReadError(
            f"{path}: the Matrix Market file has {value.size} entries where its header says {expected}; it is "
            "truncated or two files in one: write or copy it again"
        )
    places = where - 1 if array is None else _array_places(shape, symmetry)
    outside = ((places < 0) | (places >= shape)).any(axis=1)
    if outside.any():
        i, j = places[outside][0] + 1
        raise ReadError(f"{path}: there is an entry at row {i}, column {j} of a {shape[0]} x {shape[1]} matrix")
    row, col = places.T
    sign = _MIRROR[symmetry]
    if sign:
        off = row != col
        row, col = np.concatenate([row, col[off]]), np.concatenate([col, row[off]])
        value = np.concatenate([value, sign * value[off]])
    rounding = rounding_of_printed(printed) if rounded else DOUBLE
    return LabelledMatrix(canonical(row, col, value, shape), path.stem, path, "matrix-market", rounding)


def _array_places(shape: tuple[int, int], symmetry: str) -> NDArray[np.int64]:
    """Row and column of each value of an array file: column after column, of one triangle if symmetric."""
    rows, cols = shape
    col, row = np.divmod(np.arange(rows * cols), rows)
    above = {"general": -cols, "skew-symmetric": 1}.get(symmetry, 0)
    kept = row - col >= above
    return np.stack([row[kept], col[kept]], axis=1)


MATRIX_MARKET = MatrixFormat(
    "matrix-market",
    "Matrix Market",
    lambda path, head: head.decode("utf-8-sig", errors="replace").startswith("%%MatrixMarket"),
    _market_matrices,
    named=False,
)
