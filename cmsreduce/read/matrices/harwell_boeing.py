"""Harwell-Boeing text, which HBMAT of ANSYS writes: assembled real matrices, by columns in Fortran's fixed fields.

scipy reads only unsymmetric ones without a right-hand side, and no exponents with D.
Source: Duff, Grimes and Lewis, Users' Guide for the Harwell-Boeing Sparse Matrix Collection, 1992.
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
from cmsreduce.read.files import is_text
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, check_size, mirrored
from cmsreduce.read.printed_numbers import INTEGER, real_number, rounding_of_printed, whole_number

__all__ = ["HARWELL_BOEING"]

_TYPE = re.compile(r"([RCPI])([SUHZR])([AE])\s", re.IGNORECASE)
_FIELD = re.compile(
    r"\(\s*(?:\d+P,?\s*)?([1-9]\d{0,2})?\s*[IEDFG]([1-9]\d{0,2})(?:\.\d+)?(?:E\d+)?\s*\)", re.IGNORECASE
)
_SYMMETRY = {"S": "symmetric", "H": "symmetric", "U": "square", "R": "rectangular", "Z": "skew-symmetric"}
# Numbers at each end that show how all are printed.
_ENDS = 1000


@dataclass(frozen=True)
class _Header:
    """Lines and fields of the pointers, row indices and values."""

    kind: str
    rows: int
    cols: int
    entries: int
    start: int
    lines: tuple[int, int, int]
    fields: tuple[tuple[int, int], ...]


def _header(text: list[str]) -> _Header | None:
    """Header of a file from its first lines; None if they are of another format."""
    if len(text) < 4 or not (kind := _TYPE.match(text[2])):
        return None
    counts = _integers(text[1])
    sizes = _integers(text[2][3:])
    formats = [_FIELD.fullmatch(part.strip()) for part in (text[3][:16], text[3][16:32], text[3][32:52])]
    if len(counts) not in (4, 5) or len(sizes) not in (3, 4) or not all(formats):
        return None
    fields = tuple((int(found[1] or 1), int(found[2])) for found in formats if found)
    # A fifth line describes right-hand sides, which follow the values.
    start = 5 if len(counts) == 5 and counts[4] > 0 else 4
    return _Header(
        kind[0].strip().upper(), sizes[0], sizes[1], sizes[2], start, (counts[1], counts[2], counts[3]), fields
    )


def _integers(line: str) -> list[int]:
    """Integers of a line; empty if it holds anything else."""
    found = [whole_number(word) for word in line.split()]
    return [number for number in found if number is not None and number >= 0] if None not in found else []


def _matrices(path: Path) -> list[StoredMatrix]:
    """The one matrix of a file.

    Raises
    ------
    ReadError
        If the matrix is not assembled, has no values or is complex. Loading raises it if numbers are missing.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        header = _header([line for _, line in zip(range(5), file, strict=False)])
    if header is None:
        raise ReadError(f"{path}: the Harwell-Boeing header is damaged; write the file again")
    check_size(path, path.stem, header.rows, header.cols, path.stat().st_size)
    if header.kind[0] != "R" or header.kind[2] != "A" or header.kind[1] == "Z":
        raise ReadError(
            f"{path}: is a Harwell-Boeing file of type {header.kind}; only assembled real matrices (RSA, RUA) are "
            "read: write it as RSA, or as a Matrix Market file"
        )
    size = (header.rows, header.cols, header.entries)
    return [StoredMatrix(path.stem, "real, as text", _SYMMETRY[header.kind[1]], size, partial(_load, path, header))]


def _load(path: Path, header: _Header) -> LabelledMatrix:
    """Read the entries; one triangle of a symmetric matrix becomes both."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    parts, at = [], header.start
    wanted = (header.cols + 1, header.entries, header.entries)
    for what, count, (each, width), number in zip(
        ("column pointers", "row indices", "values"), header.lines, header.fields, wanted, strict=True
    ):
        words = _words(lines[at : at + count], each, width, number)
        if len(words) != number:
            raise ReadError(
                f"{path}: the Harwell-Boeing file has {len(words)} {what} where its header says {number}; it is "
                "truncated or damaged: write or copy it again"
            )
        parts.append(words)
        at += count
    starts, rows = (_as_integers(path, part) for part in parts[:2])
    printed = parts[2]
    values = [real_number(word) for word in printed]
    if None in values:
        raise ReadError(f"{path}: '{printed[values.index(None)]}' is no number; the file is damaged, write it again")
    steps = np.diff(starts)
    ordered = starts[0] == 1 and starts[-1] == header.entries + 1 and (steps >= 0).all()
    if not ordered or ((rows < 1) | (rows > header.rows)).any():
        raise ReadError(f"{path}: column pointers or row indices are out of range; the file is damaged, write it again")
    shape = (header.rows, header.cols)
    col = np.repeat(np.arange(header.cols), steps)
    A: sp.csc_array = canonical(rows - 1, col, np.array(values, dtype=np.float64), shape)
    ends = printed if len(printed) <= 2 * _ENDS else [*printed[:_ENDS], *printed[-_ENDS:]]
    # ANSYS 9 writes both triangles of a .sub under the type of a symmetric matrix; such a matrix stays as it is.
    A = A if header.kind[1] in "UR" else mirrored(A)
    return LabelledMatrix(A, path.stem, path, HARWELL_BOEING.name, rounding_of_printed(ends))


def _words(lines: list[str], each: int, width: int, number: int) -> list[str]:
    """Numbers of lines with so many fields of a width: between blanks, or by fields where numbers touch."""
    words = " ".join(lines).split()
    if len(words) == number:
        return words
    fields = range(0, each * width, width)
    return [word for line in lines for at in fields if (word := line[at : at + width].strip())]


def _as_integers(path: Path, words: list[str]) -> NDArray[np.int64]:
    bad = next((word for word in words if not INTEGER.match(word)), None)
    if bad is not None:
        raise ReadError(f"{path}: '{bad}' is no row or column; the file is damaged, write it again")
    return np.array(words, dtype=np.int64)


HARWELL_BOEING = MatrixFormat(
    "harwell-boeing",
    "Harwell-Boeing",
    lambda path, head: is_text(head) and _header(head[:1000].decode("latin-1").splitlines()[:5]) is not None,
    _matrices,
    named=False,
)
