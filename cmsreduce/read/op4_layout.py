"""Layout of NASTRAN OUTPUT4 files: what matrices they hold, proven whole before any number is read.

pyYeti reads the numbers, but takes a cut file for a short one and a damaged header for a size to allocate.
"""

from __future__ import annotations

import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.printed_numbers import rounding_of_digits

__all__ = ["Op4Header", "is_ascii_header", "op4_headers"]

TYPES = {1: "real single", 2: "real double", 3: "complex single", 4: "complex double"}
FORMS = {1: "square", 2: "rectangular", 3: "diagonal", 4: "lower", 5: "upper", 6: "symmetric", 8: "identity"}
_HEADER_BYTES = {24: "i", 48: "q"}  # of the first record, with integers of 32 and 64 bits
_ROWS_FOR_BIGMAT = 65536  # from so many rows on, row numbers do not share a word with string lengths
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
        Whether numbers are printed.
    """

    name: str
    rows: int
    cols: int
    form: int
    type: int
    rounding: float
    ascii: bool


def is_ascii_header(line: str) -> bool:
    """Whether a line is the header of a matrix in a formatted OUTPUT4 file."""
    line = line.rstrip()
    return bool(_WIDE_ASCII_HEADER.fullmatch(line)) or (
        (match := _ASCII_HEADER.fullmatch(line)) is not None
        and (not match["format"].strip() or _NUMBER_FORMAT.search(match["format"].upper()) is not None)
    )


def op4_headers(path: Path) -> list[Op4Header]:
    """Headers of all matrices, after a walk over every column of each.

    Raises
    ------
    ReadError
        If the file ends early, a record does not close, or a size is absurd; with the byte or the line.
    """
    with path.open("rb") as file:
        start = file.read(4)
        if len(start) < 4:
            raise ReadError(f"{path}: the OP4 file is truncated: it has no more than {len(start)} bytes")
        if b"\0" in start:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                return list(_BinaryWalk(path, content).headers())
    return list(_AsciiWalk(path).headers())


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
            self.columns(name, abs(rows), cols)
            rounding = SINGLE if kind in (1, 3) and not self.wide else DOUBLE
            yield Op4Header(name, abs(rows), cols, form, kind, rounding, ascii=False)

    def columns(self, name: str, rows: int, cols: int) -> None:
        """Walk over the columns of one matrix, up to the one behind the last that ends it."""
        last = 0
        while True:
            what = f"matrix '{name}', after column {last} of {cols}"
            start, length = self.record(what)
            if length < self.column.size:
                raise self.damaged(what, f"has {length} bytes, too few for a column")
            col, row, words = self.column.unpack_from(self.content, start)
            if col > cols:
                return
            if col <= last:
                raise self.damaged(what, f"is of column {col}, out of order")
            if length != self.column.size + words * self.word:
                raise self.damaged(what, f"has {length} bytes but names {words} words of {self.word} bytes")
            if row < 0 or row > rows:
                raise self.damaged(what, f"starts at row {row} of {rows}")
            last = col


class _AsciiWalk:
    """Steps from line to line by the counts the column headers give."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.number = 0
        self.lines: Iterator[str] = iter(())
        self.what = ""

    def line(self) -> str:
        """Next line, which must be there."""
        for line in self.lines:
            self.number += 1
            return line.rstrip("\n")
        raise ReadError(
            f"{self.path}: the OP4 file is truncated: it ends after line {self.number} ({self.path.stat().st_size} "
            f"bytes), in {self.what}; write or copy it again"
        )

    def integers(self, count: int) -> list[int]:
        """Integers of the next line, eight characters each; a single one may be wider."""
        line = self.line()
        try:
            return [int(line)] if count == 1 else [int(line[8 * k : 8 * k + 8]) for k in range(count)]
        except ValueError:
            raise ReadError(
                f"{self.path}, line {self.number}: '{line[:40]}' should be {count} integers, in {self.what}; the OP4 "
                "file is truncated or damaged: write or copy it again"
            ) from None

    def headers(self) -> Iterator[Op4Header]:
        """Walk over all matrices."""
        file_bytes = self.path.stat().st_size
        with self.path.open(encoding="latin-1") as self.lines:
            for line in self.lines:
                self.number += 1
                if not line.strip():
                    return
                yield self.matrix(line.rstrip(), file_bytes)

    def matrix(self, line: str, file_bytes: int) -> Op4Header:
        """Walk over one matrix whose header is given."""
        match = _WIDE_ASCII_HEADER.fullmatch(line) or _ASCII_HEADER.fullmatch(line)
        # A blank among the digits of a field is not seen by its pattern.
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
        self.columns(name, abs(rows), cols, rows < 0 or rows >= _ROWS_FOR_BIGMAT, kind, count, width)
        rounding = max(rounding_of_digits(digits), SINGLE if kind in (1, 3) else DOUBLE)
        return Op4Header(name, abs(rows), cols, form, kind, rounding, ascii=True)

    def columns(self, name: str, rows: int, cols: int, bigmat: bool, kind: int, per_line: int, width: int) -> None:
        """Walk over the columns of one matrix, up to the one behind the last that ends it."""
        words_each = 1 if kind in (1, 3) else 2
        last = 0
        while True:
            self.what = f"matrix '{name}' after column {last} of {cols}"
            col, row, words = self.integers(3)
            if col > cols:
                self.numbers(1, per_line, width)
                return
            if col <= last or row < 0 or row > rows:
                raise ReadError(
                    f"{self.path}, line {self.number}: column {col}, row {row} is out of order in {self.what}; the OP4 "
                    "file is damaged: write or copy it again"
                )
            last = col
            if row > 0:
                self.numbers(words, per_line, width)
                continue
            while words > 0:
                if bigmat:
                    length, _ = self.integers(2)
                    words -= length + 1
                    length -= 1
                else:
                    length = (self.integers(1)[0] >> 16) - 1
                    words -= length + 1
                self.numbers(length // words_each, per_line, width)

    def numbers(self, count: int, per_line: int, width: int) -> None:
        """Step over printed numbers; a line too short for its share would shift all that follow."""
        if count < 1:
            raise ReadError(
                f"{self.path}, line {self.number}: a string of {count} numbers in {self.what}; the OP4 file is damaged"
            )
        while count > 0:
            line = self.line()
            share = min(count, per_line)
            if len(line) < share * width:
                raise ReadError(
                    f"{self.path}, line {self.number}: holds {len(line)} characters where {share} numbers of {width} "
                    f"are due, in {self.what}; the OP4 file is truncated or damaged: write or copy it again"
                )
            count -= share
