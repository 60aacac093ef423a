"""Matrices of NASTRAN OUTPUT4 files: strings of numbers become sparse arrays without a dense array between."""

from __future__ import annotations

import struct
from array import array
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_head, reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, mirrored
from cmsreduce.read.nastran.op4_binary import BinaryRecords
from cmsreduce.read.nastran.op4_header import TYPES, Op4Header
from cmsreduce.read.nastran.op4_printed import PrintedRecords, is_printed_header
from cmsreduce.read.printed_numbers import real_number

__all__ = ["FORMS", "OP4", "SYMMETRIC", "first_record"]

FORMS = {1: "square", 2: "rectangular", 3: "diagonal", 4: "lower", 5: "upper", 6: "symmetric", 8: "identity"}
SYMMETRIC = 6
# Bytes of numbers that are searched for zeros together: many strings, but little beside a dense file.
_AT_ONCE = 8_000_000


def first_record(head: bytes) -> set[int]:
    """Possible lengths of the first Fortran record of a file, in either byte order.

    The same length is written before and after a record. A file that is cut inside the record still has the first.
    """
    lengths = [struct.unpack_from(order + "i", head)[0] for order in "<>"] if len(head) >= 4 else []
    closing = {length: head[4 + length : 8 + length] for length in lengths if length >= 0}
    return {length for length, end in closing.items() if end == head[: len(end)]}


def _op4_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of an OP4 file of 32 or 64-bit integers and any precision, dense or sparse, also with big matrices.

    Raises
    ------
    ReadError
        If the file is truncated or damaged; the whole file is checked first. Loading raises it if a number does not
        parse.
    """
    start = read_head(path, 4)
    if len(start) < 4:
        raise ReadError(f"{path}: the OP4 file is truncated: it has no more than {len(start)} bytes")
    if b"\0" not in start:
        headers = list(PrintedRecords(path).headers())
    else:
        with BinaryRecords.of(path) as records:
            headers = list(records.headers())
    return [
        StoredMatrix(
            header.name or f"m{k}",
            TYPES[header.type] + (f", {round(-np.log10(2 * header.rounding))} digits" if header.ascii else ""),
            FORMS.get(header.form, f"form {header.form}"),
            (header.rows, header.cols, None),
            partial(_load, path, header, header.name or f"m{k}"),
        )
        for k, header in enumerate(headers)
    ]


def _load(path: Path, header: Op4Header, name: str) -> LabelledMatrix:
    """Read one matrix."""
    found = _Strings(header.number)
    with reading(path, f"OP4 matrix '{header.name}'"):
        if header.ascii:
            for row, column, count, text in PrintedRecords(path).strings(header):
                # numpy would take twice the time for these numbers.
                found.add(row, column, count, array("d", _numbers(text, count, header.width, row, column)).tobytes())
        else:
            with BinaryRecords.of(path) as records:
                for string in records.strings(header):
                    found.add(*string)
        A = found.assemble(header.rows, header.cols)
    if header.form == SYMMETRIC:
        A = mirrored(A)
    return LabelledMatrix(A, name, path, "op4", header.rounding)


class _Strings:
    """Strings of numbers of a matrix, collected; the zeros of dense files are dropped in time to save memory."""

    def __init__(self, number: str) -> None:
        self._number = np.dtype(number)
        self._starts, self._counts, self._columns, self._values = array("q"), array("q"), array("q"), bytearray()
        self._kept: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]] = []

    def add(self, row: int, column: int, count: int, values: bytes) -> None:
        """Add a string that starts at a row and column counted from zero."""
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
        # Row of the first number of each string, minus the place of that number among all numbers.
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


def _is_op4(path: Path, head: bytes) -> bool:
    # Printed files may hold zero bytes, in the names of matrices.
    printed = is_printed_header(head.split(b"\n", 1)[0].decode("latin-1"))
    return printed or bool(first_record(head) & {24, 48})


OP4 = MatrixFormat("op4", "NASTRAN OUTPUT4, printed or binary", _is_op4, _op4_matrices)
