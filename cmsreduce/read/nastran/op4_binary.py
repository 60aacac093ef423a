"""Records of binary NASTRAN OUTPUT4 files: each file is checked to its end before a number is read.

Integers have 32 or 64 bits in either byte order. Columns are dense, or strings of numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.files import FileBytes
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.nastran.op4_header import ROWS_FOR_BIGMAT, TYPES, Op4Header

__all__ = ["BinaryRecords"]

_HEADER_BYTES = {24: "i", 48: "q"}  # of the first record, with integers of 32 and 64 bits


class BinaryRecords:
    """Records of a binary file, read one after another; each has its length before and after it.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    ReadError
        If the file ends early, a record does not close, a string does not end within its column, or a size is absurd;
        with the byte.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.content = path, FileBytes(path)
        self.size = len(self.content)
        self.at = 0
        order = "<" if self.content.unpack(struct.Struct("<i"), 0)[0] in _HEADER_BYTES else ">"
        self.marker = struct.Struct(order + "i")
        length = self.content.unpack(self.marker, 0)[0]
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

    def _record(self, what: str) -> tuple[int, int]:
        """Start and length of the next record, which must be whole."""
        start = self.at + 4
        if start > self.size:
            raise self._cut(what, start)
        length = self.content.unpack(self.marker, self.at)[0]
        if length < 0:
            raise self._damaged(what, f"opens with the length {length}")
        if start + length + 4 > self.size:
            raise self._cut(what, start + length + 4)
        closing = self.content.unpack(self.marker, start + length)[0]
        if closing != length:
            raise self._damaged(what, f"opens with the length {length} and closes with {closing}")
        self.at = start + length + 4
        return start, length

    def _cut(self, what: str, needed: int) -> ReadError:
        return ReadError(
            f"{self.path}: the OP4 file is truncated in {what}: it needs {needed} bytes up to there and has "
            f"{self.size}; write it again, or copy it again in binary mode"
        )

    def _damaged(self, what: str, why: str) -> ReadError:
        return ReadError(
            f"{self.path}: the OP4 file is damaged at byte {self.at}: the record of {what} {why}; copy it again in "
            "binary mode"
        )

    def headers(self) -> Iterator[Op4Header]:
        """Headers of all matrices, each after a check of all its columns."""
        count = 0
        while self.at < self.size:
            count += 1
            what = f"the header of matrix {count}"
            start, length = self._record(what)
            if length != self.header.size:
                raise self._damaged(what, f"has {length} bytes instead of {self.header.size}")
            cols, rows, form, kind, raw = self.content.unpack(self.header, start)
            # NASTRAN spreads a name over words of eight bytes, four letters in each.
            spread = self.wide and not raw[4:8].strip(b" \0")
            name = (raw[:4] + raw[8:12] if spread else raw).decode("latin-1").strip(" \0")
            check_size(self.path, name, abs(rows), cols, self.size)
            if kind not in TYPES:
                raise self._damaged(what, f"gives type {kind} to '{name}', which is none of 1, 2, 3, 4")
            rounding = SINGLE if kind in (1, 3) and not self.wide else DOUBLE
            header = Op4Header(
                *(name, abs(rows), cols, form, kind, rounding),
                ascii=False,
                start=self.at,
                number=f"{self.order}f{self.word if kind in (1, 3) else 8}",
                bigmat=rows < 0 or rows >= ROWS_FOR_BIGMAT,
            )
            for _ in self._columns(header):
                pass
            yield header

    def _columns(self, header: Op4Header) -> Iterator[tuple[int, int, int, int]]:
        """Column, row, first byte and words of each column; a column number beyond the last ends the matrix."""
        last, name = 0, header.name
        while True:
            what = f"matrix '{name}', after column {last} of {header.cols}"
            start, length = self._record(what)
            if length < self.column.size:
                raise self._damaged(what, f"has {length} bytes, too few for a column")
            col, row, words = self.content.unpack(self.column, start)
            if col > header.cols:
                return
            if col <= last:
                raise self._damaged(what, f"is of column {col}, out of order")
            if length != self.column.size + words * self.word:
                raise self._damaged(what, f"has {length} bytes but names {words} words of {self.word} bytes")
            if row < 0 or row > header.rows:
                raise self._damaged(what, f"starts at row {row} of {header.rows}")
            last = col
            yield col, row, start + self.column.size, words

    def strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, bytes]]:
        """Row and column, from 0, count and bytes of each string of numbers of a matrix."""
        self.at = header.start
        content, size = self.content, int(header.number[-1])
        for col, row, start, words in self._columns(header):
            end = start + words * self.word
            if row > 0:
                yield row - 1, col - 1, (end - start) // size, content[start:end]
                continue
            while start < end:
                if header.bigmat:
                    length, first = content.unpack(self.place, start)
                    start += self.place.size
                    length -= 1
                else:
                    (both,) = content.unpack(self.row, start)
                    start += self.word
                    length, first = (both >> 16) - 1, both & 0xFFFF
                count, stop = length * self.word // size, start + length * self.word
                if count < 1 or stop > end or not 0 < first <= header.rows - count // header.parts + 1:
                    raise self._damaged(
                        f"matrix '{header.name}', column {col},", f"has a string of {count} numbers at row {first}"
                    )
                yield first - 1, col - 1, count, content[start:stop]
                start = stop
