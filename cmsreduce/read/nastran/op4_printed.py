"""Formatted NASTRAN OUTPUT4 files: their matrices, proven whole before any is taken, and strings of printed numbers."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.nastran.op4_layout import ROWS_FOR_BIGMAT, TYPES, Op4Header
from cmsreduce.read.printed_numbers import rounding_of_digits

__all__ = ["is_ascii_header", "printed_headers", "printed_strings"]

_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{7}\d)(?P<rows>[ \d-]{7}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)(?P<name>.{0,8})(?P<format>.*)"
)
_WIDE_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{15}\d)(?P<rows>[ \d-]{15}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)"
    r"(?P<name>.{8})(?P<format>.*)\|I16"
)
_NUMBER_FORMAT = re.compile(r"(?P<scale>1P,)?(?P<count>\d+)[ED](?P<width>\d+)\.(?P<digits>\d+)")


def is_ascii_header(line: str) -> bool:
    """Whether a line is the header of a matrix in a formatted OUTPUT4 file."""
    line = line.rstrip()
    return bool(_WIDE_ASCII_HEADER.fullmatch(line)) or (
        (match := _ASCII_HEADER.fullmatch(line)) is not None
        and (not match["format"].strip() or _NUMBER_FORMAT.search(match["format"].upper()) is not None)
    )


def printed_headers(path: Path) -> list[Op4Header]:
    """Headers of all matrices of a formatted file, after a walk over every line of each.

    Raises
    ------
    ReadError
        If the file ends early, a line is too short, or a size is absurd; with the line.
    """
    return list(_AsciiWalk(path).headers())


def printed_strings(path: Path, header: Op4Header) -> Iterator[tuple[int, int, int, str]]:
    """Strings of numbers down the columns of a matrix in a formatted file.

    Yields
    ------
    row, column : int
        Where a string starts, from 0.
    count : int
        Numbers of the string.
    text : str
        All of them, ``header.width`` characters each.
    """
    walk = _AsciiWalk(path)
    with path.open(encoding="latin-1") as lines:
        walk.lines, walk.number = islice(lines, header.start, None), header.start
        yield from walk.strings(header)


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
        rounding = max(rounding_of_digits(digits), SINGLE if kind in (1, 3) else DOUBLE)
        header = Op4Header(
            *(name, abs(rows), cols, form, kind, rounding),
            ascii=True,
            start=self.number,
            width=width,
            per_line=count,
            bigmat=rows < 0 or rows >= ROWS_FOR_BIGMAT,
        )
        for _ in self.strings(header):
            pass
        return header

    def strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, str]]:
        """Row and column, from 0, and text of each string of a matrix, up to the one behind the last column."""
        last = 0
        while True:
            self.what = f"matrix '{header.name}' after column {last} of {header.cols}"
            col, row, words = self.integers(3)
            if col > header.cols:
                self.numbers(1, header)
                return
            if col <= last or row < 0 or row > header.rows:
                raise ReadError(
                    f"{self.path}, line {self.number}: column {col}, row {row} is out of order in {self.what}; the OP4 "
                    "file is damaged: write or copy it again"
                )
            last = col
            if row > 0:
                yield row - 1, col - 1, words, self.numbers(words, header)
                continue
            while words > 0:
                if header.bigmat:
                    length, first = self.integers(2)
                    words -= length + 1
                    length -= 1
                else:
                    both = self.integers(1)[0]
                    length, first = (both >> 16) - 1, both & 0xFFFF
                    words -= length + 1
                count = length // header.words_each
                yield first - 1, col - 1, count, self.numbers(count, header)

    def numbers(self, count: int, header: Op4Header) -> str:
        """Text of printed numbers; a line too short for its share would shift all that follow."""
        if count < 1:
            raise ReadError(
                f"{self.path}, line {self.number}: a string of {count} numbers in {self.what}; the OP4 file is damaged"
            )
        found = []
        while count > 0:
            line = self.line()
            share = min(count, header.per_line)
            if len(line) < share * header.width:
                raise ReadError(
                    f"{self.path}, line {self.number}: holds {len(line)} characters where {share} numbers of "
                    f"{header.width} are due, in {self.what}; the OP4 file is truncated or damaged: write or copy it "
                    "again"
                )
            found.append(line[: share * header.width])
            count -= share
        return "".join(found)
