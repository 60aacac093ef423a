"""Binary NASTRAN OUTPUT4 files: their matrices, proven whole before any number is read, and strings of numbers.

Integers of 32 or 64 bits, either byte order, dense or sparse columns.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size

__all__ = ["FORMS", "ROWS_FOR_BIGMAT", "TYPES", "Op4Header", "binary_headers", "binary_strings"]

TYPES = {1: "real single", 2: "real double", 3: "complex single", 4: "complex double"}
FORMS = {1: "square", 2: "rectangular", 3: "diagonal", 4: "lower", 5: "upper", 6: "symmetric", 8: "identity"}
_HEADER_BYTES = {24: "i", 48: "q"}  # of the first record, with integers of 32 and 64 bits
ROWS_FOR_BIGMAT = 65536
"""Rows from which on row numbers do not share a word with lengths of strings."""


@dataclass(frozen=True)
class Op4Header:
    """Header of one matrix.

    Parameters
    ----------
    name : str
        As in the file; empty where it has none.
    rows, cols : int
        Size.
    form, type : int
        NASTRAN codes.
    rounding : float
        Relative rounding of the numbers.
    ascii : bool
        Whether numbers are printed.
    start : int
        Byte, or line, that its columns begin behind.
    number : str
        Type of a number in memory (numpy).
    width : int
        Characters of a printed number.
    per_line : int
        Printed numbers of a line.
    bigmat : bool
        Whether rows and lengths of strings have words of their own.
    """

    name: str
    rows: int
    cols: int
    form: int
    type: int
    rounding: float
    ascii: bool
    start: int
    number: str = "f8"
    width: int = 0
    per_line: int = 0
    bigmat: bool = False

    @property
    def words_each(self) -> int:
        """Words of 32 bits, by which lengths are counted, of a number."""
        return 1 if self.type in (1, 3) else 2


def binary_headers(path: Path) -> list[Op4Header]:
    """Headers of all matrices of a binary file, after a walk over every column of each.

    Raises
    ------
    ReadError
        If the file ends early, a record does not close, or a size is absurd; with the byte.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        return list(_BinaryWalk(path, content).headers())


def binary_strings(path: Path, header: Op4Header) -> Iterator[tuple[int, int, int, bytes]]:
    """Strings of numbers down the columns of a real matrix in a binary file.

    Parameters
    ----------
    path : Path
    header : Op4Header
        One of `binary_headers`.

    Yields
    ------
    row, column : int
        Where a string starts, from 0.
    count : int
        Numbers of the string.
    content : bytes
        All of them, as ``header.number`` says.

    Raises
    ------
    ReadError
        If a string does not end within its column.
    """
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        walk = _BinaryWalk(path, content)
        walk.at = header.start
        yield from walk.strings(header)


class _BinaryWalk:
    """Steps from record to record; each closes with the length that opened it."""

    def __init__(self, path: Path, content: mmap.mmap) -> None:
        self.path, self.content, self.size = path, content, len(content)
        self.at = 0
        order = "<" if struct.unpack_from("<i", content)[0] in _HEADER_BYTES else ">"
        self.marker = struct.Struct(order + "i")
        length = self.marker.unpack_from(content)[0]
        if length not in _HEADER_BYTES:
            raise ReadError(
                f"{path}: not a binary OP4 file: it opens with a record of {length} bytes instead of 24 or 48"
            )
        integer = _HEADER_BYTES[length]
        self.wide = integer == "q"
        self.header = struct.Struct(f"{order}4{integer}{16 if self.wide else 8}s")
        self.column = struct.Struct(f"{order}3{integer}")
        self.word = 8 if self.wide else 4
        self.order, self.row, self.place = order, struct.Struct(order + integer), struct.Struct(f"{order}2{integer}")

    def record(self, what: str) -> tuple[int, int]:
        """Start and length of the next record, which must be whole."""
        start = self.at + 4
        if start > self.size:
            raise self.cut(what, start)
        length = self.marker.unpack_from(self.content, self.at)[0]
        if length < 0:
            raise self.damaged(what, f"opens with the length {length}")
        if start + length + 4 > self.size:
            raise self.cut(what, start + length + 4)
        closing = self.marker.unpack_from(self.content, start + length)[0]
        if closing != length:
            raise self.damaged(what, f"opens with the length {length} and closes with {closing}")
        self.at = start + length + 4
        return start, length

    def cut(self, what: str, needed: int) -> ReadError:
        return ReadError(
            f"{self.path}: the OP4 file is truncated in {what}: it needs {needed} bytes up to there and has "
            f"{self.size}; write it again, or copy it again in binary mode"
        )

    def damaged(self, what: str, why: str) -> ReadError:
        return ReadError(
            f"{self.path}: the OP4 file is damaged at byte {self.at}: the record of {what} {why}; copy it again in "
            "binary mode"
        )

    def headers(self) -> Iterator[Op4Header]:
        """Walk over all matrices."""
        count = 0
        while self.at < self.size:
            count += 1
            what = f"the header of matrix {count}"
            start, length = self.record(what)
            if length != self.header.size:
                raise self.damaged(what, f"has {length} bytes instead of {self.header.size}")
            cols, rows, form, kind, raw = self.header.unpack_from(self.content, start)
            name = raw.decode("latin-1").strip(" \0")
            check_size(self.path, name, abs(rows), cols, self.size)
            if kind not in TYPES:
                raise self.damaged(what, f"gives type {kind} to '{name}', which is none of 1, 2, 3, 4")
            rounding = SINGLE if kind in (1, 3) and not self.wide else DOUBLE
            header = Op4Header(
                *(name, abs(rows), cols, form, kind, rounding),
                ascii=False,
                start=self.at,
                number=f"{self.order}f{self.word if kind in (1, 3) else 8}",
                bigmat=rows < 0 or rows >= ROWS_FOR_BIGMAT,
            )
            for _ in self.columns(header):
                pass
            yield header

    def columns(self, header: Op4Header) -> Iterator[tuple[int, int, int, int]]:
        """Column, row, first byte and words of each column of a matrix, up to the one behind the last that ends it."""
        last, name = 0, header.name
        while True:
            what = f"matrix '{name}', after column {last} of {header.cols}"
            start, length = self.record(what)
            if length < self.column.size:
                raise self.damaged(what, f"has {length} bytes, too few for a column")
            col, row, words = self.column.unpack_from(self.content, start)
            if col > header.cols:
                return
            if col <= last:
                raise self.damaged(what, f"is of column {col}, out of order")
            if length != self.column.size + words * self.word:
                raise self.damaged(what, f"has {length} bytes but names {words} words of {self.word} bytes")
            if row < 0 or row > header.rows:
                raise self.damaged(what, f"starts at row {row} of {header.rows}")
            last = col
            yield col, row, start + self.column.size, words

    def strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, bytes]]:
        """Row and column, from 0, count and bytes of each string of a matrix."""
        content, size = self.content, int(header.number[-1])
        for col, row, start, words in self.columns(header):
            end = start + words * self.word
            if row > 0:
                yield row - 1, col - 1, (end - start) // size, content[start:end]
                continue
            while start < end:
                if header.bigmat:
                    length, first = self.place.unpack_from(content, start)
                    start += self.place.size
                    length -= 1
                else:
                    (both,) = self.row.unpack_from(content, start)
                    start += self.word
                    length, first = (both >> 16) - 1, both & 0xFFFF
                count, stop = length * self.word // size, start + length * self.word
                if count < 1 or stop > end or not 0 < first <= header.rows - count + 1:
                    raise self.damaged(
                        f"matrix '{header.name}', column {col},", f"has a string of {count} numbers at row {first}"
                    )
                yield first - 1, col - 1, count, content[start:stop]
                start = stop
