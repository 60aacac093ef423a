"""Matrices of NASTRAN OUTPUT4 files, whose strings of numbers become sparse arrays without a dense one between."""

from __future__ import annotations

from array import array
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import LabelledMatrix, StoredMatrix, canonical, mirrored
from cmsreduce.read.library_errors import reading
from cmsreduce.read.nastran.cards import real_number
from cmsreduce.read.nastran.op4_layout import FORMS, TYPES, Op4Header, binary_headers, binary_strings
from cmsreduce.read.nastran.op4_printed import printed_headers, printed_strings

__all__ = ["op4_matrices"]

_SYMMETRIC = 6
# Bytes that are looked through for zeros together: much beside one string and little beside a dense file.
_AT_ONCE = 8_000_000


def op4_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of an OP4 file.

    Parameters
    ----------
    path : Path
        File of 32 or 64-bit integers, single or double precision, dense, sparse, or sparse with big matrices.

    Returns
    -------
    list of StoredMatrix
        In the order of the file; loading one raises ReadError if a number in it does not parse.

    Raises
    ------
    ReadError
        If the file is truncated or damaged; all of it is walked over first.
    """
    return [_stored(path, header, header.name or f"m{k}") for k, header in enumerate(_headers(path))]


def _headers(path: Path) -> list[Op4Header]:
    with path.open("rb") as file:
        start = file.read(4)
    if len(start) < 4:
        raise ReadError(f"{path}: the OP4 file is truncated: it has no more than {len(start)} bytes")
    return binary_headers(path) if b"\0" in start else printed_headers(path)


def _stored(path: Path, header: Op4Header, name: str) -> StoredMatrix:
    digits = f", {round(-np.log10(2 * header.rounding))} digits" if header.ascii else ""
    return StoredMatrix(
        name,
        f"{TYPES[header.type]}{digits}",
        FORMS.get(header.form, f"form {header.form}"),
        lambda: (header.rows, header.cols, None),
        lambda: _load(path, header, name),
    )


def _load(path: Path, header: Op4Header, name: str) -> LabelledMatrix:
    """Read one matrix."""
    found = _Strings(header.number)
    with reading(path, f"OP4 matrix '{header.name}'"):
        if header.ascii:
            for row, column, count, text in printed_strings(path, header):
                # As an array first: numpy takes one number after the other in twice the time.
                found.add(row, column, count, array("d", _numbers(text, count, header.width, row, column)).tobytes())
        else:
            for string in binary_strings(path, header):
                found.add(*string)
        A = found.assemble(header.rows, header.cols)
    if header.form == _SYMMETRIC:
        A = mirrored(A)
    return LabelledMatrix(A, name, path, "op4", header.rounding)


class _Strings:
    """Strings of numbers down a column, one after the other; the zeros of dense files are soon dropped."""

    def __init__(self, number: str) -> None:
        self._number = np.dtype(number)
        self._starts, self._counts, self._columns, self._values = array("q"), array("q"), array("q"), bytearray()
        self._kept: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []

    def add(self, row: int, column: int, count: int, values: bytes) -> None:
        """Take a string that starts at a row, both counted from zero."""
        self._starts.append(row)
        self._counts.append(count)
        self._columns.append(column)
        self._values += values
        if len(self._values) >= _AT_ONCE:
            self._drop_zeros()

    def assemble(self, rows: int, columns: int) -> sp.csc_array:
        """Sparse array of all strings."""
        self._drop_zeros()
        row, column, values = (np.concatenate(parts) for parts in zip(*self._kept, strict=True))
        return canonical(row, column, values, (rows, columns))

    def _drop_zeros(self) -> None:
        starts, counts, columns = (np.array(part, np.int64) for part in (self._starts, self._counts, self._columns))
        values = np.frombuffer(bytes(self._values), self._number).astype(np.float64)
        kept = np.flatnonzero(values)
        # Row of the first number of each string, less the place of that number among all.
        ahead = starts - (np.cumsum(counts) - counts)
        string = np.repeat(np.arange(counts.size), counts)[kept]
        self._kept.append((kept + ahead[string], columns[string], values[kept]))
        for part in (self._starts, self._counts, self._columns):
            del part[:]
        self._values.clear()


def _numbers(text: str, count: int, width: int, row: int, column: int) -> list[float]:
    """Printed numbers of one width."""
    numbers = [text[at : at + width] for at in range(0, count * width, width)]
    try:
        return [float(number) for number in numbers]
    except ValueError:
        # Fortran drops the letter of an exponent of three digits, and may write D for E.
        values = [real_number(number) for number in numbers]
        if None in values:
            bad = numbers[values.index(None)].strip()
            place = f"column {column + 1}, row {row + values.index(None) + 1}"
            raise ValueError(f"'{bad}' in {place} is not a number") from None
        return [value for value in values if value is not None]
