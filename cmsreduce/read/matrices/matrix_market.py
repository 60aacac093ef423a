"""Matrix Market files: header through scipy, entries line by line.

scipy's reader of entries reads past the end of a file that is cut inside a number, and takes the process with it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, LabelledMatrix, StoredMatrix, canonical, check_size
from cmsreduce.read.library_errors import reading
from cmsreduce.read.matrices.entry_lines import COORDINATE, VALUE, read_entries
from cmsreduce.read.printed_numbers import rounding_of_printed

__all__ = ["market_matrices"]

# Sign of the triangle that is left out; real numbers are Hermitian where they are symmetric.
_MIRROR = {"general": 0.0, "symmetric": 1.0, "hermitian": 1.0, "skew-symmetric": -1.0}

# Comments and empty lines, then the sizes.
_HEAD = re.compile(r"(?:[ \t\r]*(?:%[^\n]*)?\n)*[^\n]*\n?")


@dataclass(frozen=True)
class _Header:
    """What the first lines say; ``layout`` is coordinate or array."""

    rows: int
    cols: int
    entries: int
    layout: str
    field: str
    symmetry: str


def market_matrices(path: Path) -> list[StoredMatrix]:
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
    return [StoredMatrix(path.stem, numbers, header.symmetry, lambda: size, lambda: _load(path, header))]


def _load(path: Path, header: _Header) -> LabelledMatrix:
    """Read the matrix."""
    entries = read_entries(path, _body(path), COORDINATE if header.layout == "coordinate" else VALUE)
    shape = header.rows, header.cols
    due = header.entries if header.layout == "coordinate" else _array_length(header)
    if entries.value.size != due:
        raise ReadError(
            f"{path}: the Matrix Market file has {entries.value.size} entries where its header says {due}; it is "
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
    """Text with the lines up to the sizes blanked, so that the others keep their numbers."""
    text = path.read_text(encoding="utf-8", errors="replace")
    head = _HEAD.match(text)
    end = head.end() if head else 0
    return "\n" * text.count("\n", 0, end) + text[end:]


def _array_length(header: _Header) -> int:
    """Values that an array file prints."""
    n = header.rows
    return {"general": n * header.cols, "skew-symmetric": n * (n - 1) // 2}.get(header.symmetry, n * (n + 1) // 2)


def _array_places(header: _Header) -> NDArray[np.int64]:
    """Row and column of each value of an array file: down the columns, of one triangle if symmetric."""
    col, row = np.divmod(np.arange(header.rows * header.cols), header.rows)
    above = {"general": -header.cols, "skew-symmetric": 1}.get(header.symmetry, 0)
    kept = row - col >= above
    return np.stack([row[kept], col[kept]], axis=1)
