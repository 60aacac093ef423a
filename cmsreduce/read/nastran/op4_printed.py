"""Lines of printed NASTRAN OUTPUT4 files: each file is checked to its end before a number is read."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.nastran.op4_header import ROWS_FOR_BIGMAT, TYPES, Op4Header
from cmsreduce.read.printed_numbers import rounding_of_digits

__all__ = ["PrintedRecords", "is_printed_header"]

_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{7}\d)(?P<rows>[ \d-]{7}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)(?P<name>.{0,8})(?P<format>.*)"
)
_WIDE_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{15}\d)(?P<rows>[ \d-]{15}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)"
    r"(?P<name>.{8})(?P<format>.*)\|I16"
)
_NUMBER_FORMAT = re.compile(r"(?P<scale>1P,)?(?P<count>\d+)[ED](?P<width>\d+)\.(?P<digits>\d+)")


def is_printed_header(line: str) -> bool:
    """True for a line that is the header of a matrix in a formatted OUTPUT4 file."""
    line = line.rstrip()
    return bool(_WIDE_ASCII_HEADER.fullmatch(line)) or (
        (match := _ASCII_HEADER.fullmatch(line)) is not None
        and (not match["format"].strip() or _NUMBER_FORMAT.search(match["format"].upper()) is not None)
    )


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
            bigmat=rows < 0 or rows >= ROWS_FOR_BIGMAT,
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
