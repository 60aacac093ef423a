"""Matrices of NASTRAN OUTPUT4 files: strings of numbers become sparse arrays without a dense array between."""

from __future__ import annotations

import struct
from array import array
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_head, reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, complex_refused, mirrored
from cmsreduce.read.nastran.op4_binary import BinaryRecords
from cmsreduce.read.nastran.op4_header import TYPES, Op4Header
from cmsreduce.read.nastran.op4_printed import PrintedRecords, PrintedStrings, is_printed_header

__all__ = ["FORMS", "OP4", "SYMMETRIC", "first_record"]

FORMS = {1: "square", 2: "rectangular", 3: "diagonal", 4: "lower", 5: "upper", 6: "symmetric", 8: "identity"}
SYMMETRIC = 6

Ints = NDArray[np.int64]
Entries = tuple[Ints, Ints, NDArray[np.float64]]
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
    found: list[tuple[Op4Header, PrintedStrings | None]]
    if b"\0" not in start:
        found = list(PrintedRecords(path).matrices())
    else:
        found = [(header, None) for header in BinaryRecords(path).headers()]
    return [
        StoredMatrix(
            header.name or f"m{k}",
            TYPES[header.type] + (f", {round(-np.log10(2 * header.rounding))} digits" if header.ascii else ""),
            FORMS.get(header.form, f"form {header.form}"),
            (header.rows, header.cols, None),
            partial(_load, path, header, strings, header.name or f"m{k}"),
        )
        for k, (header, strings) in enumerate(found)
    ]


def _load(path: Path, header: Op4Header, strings: PrintedStrings | None, name: str) -> LabelledMatrix:
    """Read one matrix."""
    with reading(path, f"OP4 matrix '{header.name}'"):
        parts = list(_binary_entries(path, header) if strings is None else _printed_entries(path, header, strings))
        # A matrix of zeros, such as that of no damping, has no strings.
        parts = parts or [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
        row, column, values = (np.concatenate(each) for each in zip(*parts, strict=True))
        A = canonical(row, column, values, (header.rows, header.cols))
    if header.form == SYMMETRIC:
        A = mirrored(A)
    return LabelledMatrix(A, name, path, "op4", header.rounding)


def _printed_entries(path: Path, header: Op4Header, strings: PrintedStrings) -> Iterator[Entries]:
    for part, values in PrintedRecords(path).numbers(header, strings):
        yield _without_zeros(path, header, strings.row[part], strings.count[part], strings.column[part], values)


def _binary_entries(path: Path, header: Op4Header) -> Iterator[Entries]:
    starts, counts, columns, found = array("q"), array("q"), array("q"), bytearray()

    def taken() -> Entries:
        values = np.frombuffer(bytes(found), header.number).astype(np.float64)
        places = [np.array(part, np.int64) for part in (starts, counts, columns)]
        entries = _without_zeros(path, header, places[0], places[1], places[2], values)
        for part in (starts, counts, columns):
            del part[:]
        found.clear()
        return entries

    for row, column, count, content in BinaryRecords(path).strings(header):
        starts.append(row)
        counts.append(count)
        columns.append(column)
        found += content
        if len(found) >= _AT_ONCE:
            yield taken()
    yield taken()


def _without_zeros(
    path: Path, header: Op4Header, starts: Ints, counts: Ints, columns: Ints, values: NDArray[np.float64]
) -> Entries:
    """Row, column and value of the numbers of some strings that are not zero; dense files are full of zeros.

    Raises
    ------
    ReadError
        If an entry has an imaginary part.
    """
    kept = np.flatnonzero(values)
    # Number of the first number of each string among all numbers.
    first = np.cumsum(counts) - counts
    string = np.repeat(np.arange(counts.size), counts)[kept]
    row, part = np.divmod(kept - first[string], header.parts)
    if part.any():
        raise complex_refused(path, header.name)
    return row + starts[string], columns[string], values[kept]


def _is_op4(path: Path, head: bytes) -> bool:
    # Printed files may hold zero bytes, in the names of matrices.
    printed = is_printed_header(head.split(b"\n", 1)[0].decode("latin-1"))
    return printed or bool(first_record(head) & {24, 48})


OP4 = MatrixFormat("op4", "NASTRAN OUTPUT4, printed or binary", _is_op4, _op4_matrices)
