"""Records of NASTRAN OUTPUT4 files, binary and printed: each file is checked to its end before a number is read.

A binary file has integers of 32 or 64 bits in either byte order. Columns are dense, or strings of numbers.
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.printed_numbers import rounding_of_digits

__all__ = ["TYPES", "BinaryRecords", "Op4Header", "PrintedRecords", "is_printed_header"]

TYPES = {1: "real single", 2: "real double", 3: "complex single", 4: "complex double"}
_HEADER_BYTES = {24: "i", 48: "q"}  # of the first record, with integers of 32 and 64 bits
# From this number of rows on, row numbers do not share a word with lengths of strings.
_ROWS_FOR_BIGMAT = 65536
_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{7}\d)(?P<rows>[ \d-]{7}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)(?P<name>.{0,8})(?P<format>.*)"
)
_WIDE_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{15}\d)(?P<rows>[ \d-]{15}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)"
    r"(?P<name>.{8})(?P<format>.*)\|I16"
)
_NUMBER_FORMAT = re.compile(r"(?P<scale>1P,)?(?P<count>\d+)[ED](?P<width>\d+)\.(?P<digits>\d+)")


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
        True if numbers are printed.
    start : int
        Byte, or line, after which its columns start.
    number : str
        Type of a number in memory (numpy).
    width : int
        Characters of a printed number.
    per_line : int
        Printed numbers on a line.
    bigmat : bool
        True if row numbers and lengths of strings have separate words.
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
        """Words of 32 bits of a number; lengths of strings are counted in such words."""
        return 1 if self.type in (1, 3) else 2


def is_printed_header(line: str) -> bool:
    """True for a line that is the header of a matrix in a formatted OUTPUT4 file."""
    line = line.rstrip()
    return bool(_WIDE_ASCII_HEADER.fullmatch(line)) or (
        (match := _ASCII_HEADER.fullmatch(line)) is not None
        and (not match["format"].strip() or _NUMBER_FORMAT.search(match["format"].upper()) is not None)
    )


class BinaryRecords:
    """Records of a binary file, read one after another; each has its length before and after it.

    Parameters
    ----------
    path : Path
        The file.
    content : mmap
        Its bytes.

    Raises
    ------
    ReadError
        If the file ends early, a record does not close, a string does not end within its column, or a size is absurd;
        with the byte.
    """

    @classmethod
    @contextmanager
    def of(cls, path: Path) -> Iterator[BinaryRecords]:
        """Open a file."""
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            yield cls(path, content)

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

    def _record(self, what: str) -> tuple[int, int]:
        """Start and length of the next record, which must be whole."""
        start = self.at + 4
        if start > self.size:
            raise self._cut(what, start)
        length = self.marker.unpack_from(self.content, self.at)[0]
        if length < 0:
            raise self._damaged(what, f"opens with the length {length}")
        if start + length + 4 > self.size:
            raise self._cut(what, start + length + 4)
        closing = self.marker.unpack_from(self.content, start + length)[0]
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
            cols, rows, form, kind, raw = self.header.unpack_from(self.content, start)
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
                bigmat=rows < 0 or rows >= _ROWS_FOR_BIGMAT,
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
            col, row, words = self.column.unpack_from(self.content, start)
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
                    length, first = self.place.unpack_from(content, start)
                    start += self.place.size
                    length -= 1
                else:
                    (both,) = self.row.unpack_from(content, start)
                    start += self.word
                    length, first = (both >> 16) - 1, both & 0xFFFF
                count, stop = length * self.word // size, start + length * self.word
                if count < 1 or stop > end or not 0 < first <= header.rows - count + 1:
                    raise self._damaged(
                        f"matrix '{header.name}', column {col},", f"has a string of {count} numbers at row {first}"
                    )
                yield first - 1, col - 1, count, content[start:stop]
                start = stop


class PrintedRecords:
    """Lines of a formatted file, by the counts in its column headers.

    Raises
    ------
    ReadError
        If the file ends early, a line is too short, or a size is absurd; with the line.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = 0
        self.lines: Iterator[str] = iter(())
        self.place = ""

    def _line(self) -> str:
        """Next line; a ReadError if there is none."""
        for line in self.lines:
            self.number += 1
            return line.rstrip("\n")
        raise ReadError(
            f"{self.path}: the OP4 file is truncated: it ends after line {self.number} ({self.path.stat().st_size} "
            f"bytes), in {self.place}; write or copy it again"
        )

    def _integers(self, count: int) -> list[int]:
        """Integers of the next line, eight characters each; a single one may be wider."""
        line = self._line()
        try:
            return [int(line)] if count == 1 else [int(line[8 * k : 8 * k + 8]) for k in range(count)]
        except ValueError:
            raise ReadError(
                f"{self.path}, line {self.number}: '{line[:40]}' should be {count} integers, in {self.place}; the OP4 "
                "file is truncated or damaged: write or copy it again"
            ) from None

    def headers(self) -> Iterator[Op4Header]:
        """Headers of all matrices, each after a check of all its lines."""
        file_bytes = self.path.stat().st_size
        with self.path.open(encoding="latin-1") as self.lines:
            for line in self.lines:
                self.number += 1
                if not line.strip():
                    return
                yield self._matrix(line.rstrip(), file_bytes)

    def _matrix(self, line: str, file_bytes: int) -> Op4Header:
        """Header of a matrix from its line, after a check of the lines of its columns."""
        match = _WIDE_ASCII_HEADER.fullmatch(line) or _ASCII_HEADER.fullmatch(line)
        # The pattern allows a blank among the digits of a field.
        if match is None or any(" " in match[key].strip() for key in ("rows", "cols", "form", "type")):
            raise ReadError(
                f"{self.path}, line {self.number}: '{line[:40]}' should be the header of an OP4 matrix; the file is "
                "damaged: write or copy it again"
            )
        rows, cols, form, kind = (int(match[key]) for key in ("rows", "cols", "form", "type"))
        name = match["name"].strip(" \0")
        check_size(self.path, name, abs(rows), cols, file_bytes)
        if kind not in TYPES:
            raise ReadError(
                f"{self.path}, line {self.number}: matrix '{name}' has type {kind}, which is none of 1, 2, 3, 4"
            )
        printed = _NUMBER_FORMAT.search(match["format"].upper())
        count, width, digits = (int(printed[k]) for k in ("count", "width", "digits")) if printed else (5, 16, 9)
        # Without the scale factor 1P a Fortran format prints 0.123, one digit less.
        digits += 1 if printed is None or printed["scale"] else 0
        rounding = max(rounding_of_digits(digits), SINGLE if kind in (1, 3) else DOUBLE)
        header = Op4Header(
            *(name, abs(rows), cols, form, kind, rounding),
            ascii=True,
            start=self.number,
            width=width,
            per_line=count,
            bigmat=rows < 0 or rows >= _ROWS_FOR_BIGMAT,
        )
        for _ in self._strings(header):
            pass
        return header

    def strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, str]]:
        """Row and column, from 0, count and text of each string of numbers of a matrix."""
        with self.path.open(encoding="latin-1") as lines:
            self.lines, self.number = islice(lines, header.start, None), header.start
            yield from self._strings(header)

    def _strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, str]]:
        """Strings from the next line on; a column number beyond the last ends the matrix."""
        last = 0
        while True:
            self.place = f"matrix '{header.name}' after column {last} of {header.cols}"
            col, row, words = self._integers(3)
            if col > header.cols:
                self._numbers(1, header)
                return
            if col <= last or row < 0 or row > header.rows:
                raise ReadError(
                    f"{self.path}, line {self.number}: column {col}, row {row} is out of order in {self.place}; "
                    "the OP4 file is damaged: write or copy it again"
                )
            last = col
            if row > 0:
                yield row - 1, col - 1, words, self._numbers(words, header)
                continue
            while words > 0:
                if header.bigmat:
                    length, first = self._integers(2)
                    words -= length + 1
                    length -= 1
                else:
                    both = self._integers(1)[0]
                    length, first = (both >> 16) - 1, both & 0xFFFF
                    words -= length + 1
                count = length // header.words_each
                yield first - 1, col - 1, count, self._numbers(count, header)

    def _numbers(self, count: int, header: Op4Header) -> str:
        """Text of printed numbers; a line that is too short would shift all later numbers."""
        if count < 1:
            raise ReadError(
                f"{self.path}, line {self.number}: a string of {count} numbers in {self.place}; the OP4 file is damaged"
            )
        found = []
        while count > 0:
            line = self._line()
            share = min(count, header.per_line)
            if len(line) < share * header.width:
                raise ReadError(
                    f"{self.path}, line {self.number}: holds {len(line)} characters where {share} numbers of "
                    f"{header.width} are expected, in {self.place}; the OP4 file is truncated or damaged: write or "
                    "copy it again"
                )
            found.append(line[: share * header.width])
            count -= share
        return "".join(found)
