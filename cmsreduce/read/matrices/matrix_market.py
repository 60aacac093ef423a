"""Text with one matrix entry a line, integers and then a value; Matrix Market files, which have such lines.

scipy's reader of Matrix Market files is not used: if a file is cut inside a number, it reads past its end and
crashes the process. It takes headers in the standard's capitals alone.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_head, read_lines
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import DOUBLE, LabelledMatrix, canonical, check_size, complex_refused
from cmsreduce.read.numbers_at_once import INTEGER, REAL, numbers_of
from cmsreduce.read.printed_numbers import rounding_of_printed, stops_in_a_number, whole_number

__all__ = ["COORDINATE", "LABELLED", "MATRIX_MARKET", "read_entries"]

_ENDS = 50_000  # characters at each end of a text that show how its numbers are printed
_BLANKS = r"[ \t\r]*+"
_APART = r"[ \t\r,]"

# Sign of the triangle that is left out; real numbers are Hermitian where they are symmetric.
_MIRROR = {"general": 0.0, "symmetric": 1.0, "hermitian": 1.0, "skew-symmetric": -1.0}
# Comments and empty lines, then the sizes.
_HEAD = re.compile(rb"(?:[ \t\r]*(?:%[^\n]*)?\n)*[^\n]*\n?")
_COMMENT = re.compile(rb"\n[ \t]*%[^\n]*")
_HEAD_BYTES = 1 << 20  # more than comments take
# A file whose banner is misspelt must not pass as a text of entries, of which the sizes would be the first.
_BANNER = re.compile(rb"(?:\xef\xbb\xbf)?\s*%{1,2}\s*MatrixMarket", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(rb"(?<![\d,])[+-]?\d+,\d+(?:[EeDd][+-]?\d+)?\s*\Z")
_LAYOUTS = {"coordinate": 3, "array": 2}  # numbers in the line of sizes
_FIELDS = ("real", "double", "integer", "complex", "pattern")


@dataclass(frozen=True)
class EntryLine:
    """The grammar of a line.

    Parameters
    ----------
    words : str
        Appearance of a line, for messages.
    integers : int
        Integers before the value.
    pattern : str
        Matches a line without its end.
    parts : int
        Numbers of a value: two of a complex one.
    """

    words: str
    integers: int
    pattern: str
    parts: int = 1

    def matches(self, line: str) -> bool:
        """True if a line is an entry."""
        return re.fullmatch(self.pattern, line, re.ASCII) is not None

    def begins(self, text: bytes) -> bool:
        """True if the first line of a text that is not empty is an entry."""
        return re.match(rf"\s*{self.pattern}(?:\n|\Z)".encode(), text) is not None

    def matched(self, text: bytes) -> int:
        """Characters at the start of a text that are whole lines of entries, or empty ones."""
        found = re.match(f"(?:{self.pattern}\n|{_BLANKS}\n)*+".encode(), text)
        # Before Python 3.11.5 the match may end inside the line that does not fit.
        return 0 if found is None else text.rfind(b"\n", 0, found.end()) + 1


COORDINATE = EntryLine("i j value", 2, rf"{_BLANKS}{2 * f'{INTEGER}{_APART}++'}{REAL}{_APART}*+")
# Without commas the value has a point: five integers may be anything.
_FOUR = rf"(?:{4 * f'{INTEGER}{_BLANKS},{_BLANKS}'}|{4 * f'{INTEGER}{_APART}++'}(?=[^\s,]*\.))"
LABELLED = EntryLine("node,dof, node,dof, value", 4, rf"{_BLANKS}{_FOUR}{REAL}{_APART}*+")
VALUE = EntryLine("value", 0, rf"{_BLANKS}{REAL}{_BLANKS}")
_COMPLEX = {
    "coordinate": EntryLine("i j real imaginary", 2, rf"{COORDINATE.pattern}{REAL}{_APART}*+", 2),
    "array": EntryLine("real imaginary", 0, rf"{VALUE.pattern}{REAL}{_BLANKS}", 2),
}


def read_entries(path: Path, text: bytes, line: EntryLine) -> tuple[NDArray[np.int64], NDArray[np.float64], list[str]]:
    """Read all entries of a text.

    Parameters
    ----------
    path : Path
        File of the text, for messages.
    text : bytes
        Lines of entries; empty lines are skipped.
    line : EntryLine
        Grammar of every line.

    Returns
    -------
    where : (entries, integers) int64
        Integers before each value.
    value : (entries,) float64
        Values; real parts of complex ones.
    printed : list of str
        Values as printed; only the first and the last ones of a long text.

    Raises
    ------
    ReadError
        If there are no entries, a line is no entry (with its number), the text ends inside a number, or a value has an
        imaginary part.
    """
    whole = text if text.endswith(b"\n") else text + b"\n"
    end = line.matched(whole)
    if end < len(whole):
        number, bad = whole.count(b"\n", 0, end) + 1, whole[end : whole.index(b"\n", end)]
        cut = " (the last of the file, so it is probably truncated)" if b"\n" not in text[end:] else ""
        shown = bad.decode("utf-8", errors="replace").strip()[:60]
        comma = "; it has a decimal comma: write numbers with a point" if _DECIMAL_COMMA.search(bad) else ""
        raise ReadError(f"{path}, line {number}{cut}: '{shown}' is not an entry '{line.words}' of real numbers{comma}")
    numbers = numbers_of(whole).reshape(-1, line.integers + line.parts)
    if not len(numbers):
        raise ReadError(f"{path}: there are no entries '{line.words}' in it")
    where, value, imaginary = np.split(numbers, [line.integers, line.integers + 1], axis=1)
    if imaginary.any():
        raise complex_refused(path, path.stem)
    printed = _printed_values(text, line)
    if whole is not text and stops_in_a_number(printed):
        raise ReadError(
            f"{path}: the file ends inside its last number, '{printed[-1]}'; it is truncated: write or copy it again"
        )
    return where.astype(np.int64), value[:, 0], printed


def _printed_values(text: bytes, line: EntryLine) -> list[str]:
    """Values as printed on the lines at both ends of a text."""
    lines = text.strip().split(b"\n") if len(text) <= 2 * _ENDS else []
    lines = lines or [*text[:_ENDS].strip().split(b"\n")[:-1], *text[-_ENDS:].strip().split(b"\n")[1:]]
    words = (entry.replace(b",", b" ").split() for entry in lines)
    return [word[line.integers].decode() for word in words if word]


def _market_matrices(path: Path) -> list[StoredMatrix]:
    """The one matrix of a Matrix Market file: coordinate or array; general, symmetric or skew-symmetric.

    Raises
    ------
    ReadError
        If the header is damaged, a size is absurd, or the file is a pattern without values. Loading raises it if
        entries are missing, out of range, complex, or do not parse, or a symmetric matrix has entries in both
        triangles.
    """
    layout, field, symmetry, (rows, cols, count) = _header(path)
    check_size(path, path.stem, rows, cols, path.stat().st_size)
    if field == "pattern":
        raise ReadError(f"{path}: the Matrix Market file is a pattern without values; write it with real values")
    numbers = "complex" if field == "complex" else f"{field}, as text"
    lengths = {"general": rows * cols, "skew-symmetric": rows * (rows - 1) // 2}
    # An array file lists values without their places.
    array = lengths.get(symmetry, rows * (rows + 1) // 2) if layout == "array" else None
    line = _COMPLEX[layout] if field == "complex" else COORDINATE if array is None else VALUE
    load = partial(_load, path, (rows, cols), count, array, symmetry, line, field != "integer")
    return [StoredMatrix(path.stem, numbers, symmetry, (rows, cols, count), load)]


def _header(path: Path) -> tuple[str, str, str, tuple[int, int, int]]:
    """Layout, field, symmetry, and rows, columns and entries as the header states them; capitals do not matter."""
    head = read_head(path, _HEAD_BYTES).replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    banner, _, rest = head.decode("utf-8-sig", errors="replace").lstrip().partition("\n")
    found = _HEAD.match(rest.encode())
    sizes = found[0].split(b"\n")[-2 if found[0].endswith(b"\n") else -1].split() if found else []
    words = banner.lower().removeprefix("%").removeprefix("%").split()
    layout, field, symmetry = words[2:] if len(words) == 5 else ("", "", "")
    known = layout in _LAYOUTS and field in _FIELDS and symmetry in _MIRROR
    numbers = [number for word in sizes if (number := whole_number(word.decode("latin-1"))) is not None]
    if not known or len(sizes) != _LAYOUTS[layout] or len(numbers) < len(sizes):
        raise ReadError(
            f"{path}: the Matrix Market header cannot be read; write '%%MatrixMarket matrix coordinate real symmetric' "
            "(or array, integer, general, skew-symmetric), then rows, columns and, of coordinates, entries"
        )
    rows, cols, *entries = numbers
    return layout, field, symmetry, (rows, cols, entries[0] if entries else rows * cols)


def _load(
    path: Path, shape: tuple[int, int], count: int, array: int | None, symmetry: str, line: EntryLine, rounded: bool
) -> LabelledMatrix:
    """Read the matrix: ``count`` entries with their places, or ``array`` values without places."""
    text = read_lines(path)
    head = _HEAD.match(text)
    end = head.end() if head else 0
    # Comments and the lines up to the sizes become empty, so that the other lines keep their numbers.
    body = _COMMENT.sub(b"\n", b"\n" * text.count(b"\n", 0, end) + text[end:])
    expected = count if array is None else array
    if not expected and not body.strip():
        # Zeros, such as of no damping.
        return LabelledMatrix(sp.csc_array(shape), path.stem, path, "matrix-market", DOUBLE)
    where, value, printed = read_entries(path, body, line)
    if value.size != expected:
        raise ReadError(
            f"{path}: the Matrix Market file has {value.size} entries where its header says {expected}; it is "
            "truncated or two files in one: write or copy it again"
        )
    places = where - 1 if array is None else _array_places(shape, symmetry)
    if places.min() < 0 or (places.max(axis=0) >= shape).any():
        outside = ((places < 0) | (places >= shape)).any(axis=1)
        i, j = places[outside][0] + 1
        raise ReadError(f"{path}: there is an entry at row {i}, column {j} of a {shape[0]} x {shape[1]} matrix")
    row, col = places.T
    sign = _MIRROR[symmetry]
    if sign:
        off = row != col
        _refuse_both(path, row[off] * shape[1] + col[off], col[off] * shape[1] + row[off], shape[1])
        row, col = np.concatenate([row, col[off]]), np.concatenate([col, row[off]])
        value = np.concatenate([value, sign * value[off]])
    rounding = rounding_of_printed(printed) if rounded else DOUBLE
    return LabelledMatrix(canonical(row, col, value, shape), path.stem, path, "matrix-market", rounding)


def _refuse_both(path: Path, place: NDArray[np.int64], across: NDArray[np.int64], cols: int) -> None:
    """Refuse entries on both sides of the diagonal of a symmetric matrix, each of which stands for both."""
    upper = place < across
    # Nearly all files hold one triangle: there is nothing to sort.
    if upper.any() and not upper.all() and (both := np.intersect1d(place, across)).size:
        i, j = divmod(int(both[0]), cols)
        raise ReadError(
            f"{path}: the header says that one triangle stands for both, but it names row {i + 1}, column {j + 1} "
            f"and row {j + 1}, column {i + 1}; write one triangle, or 'general' in the header"
        )


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
    lambda path, head: _BANNER.match(head) is not None,
    _market_matrices,
    named=False,
)
