"""Lines of printed NASTRAN OUTPUT4 files: each file is checked to its end before a number is read."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import FileBytes
from cmsreduce.read.labelled_matrix import DOUBLE, SINGLE, check_size
from cmsreduce.read.nastran.op4_header import ROWS_FOR_BIGMAT, TYPES, Op4Header
from cmsreduce.read.numbers_at_once import reals_of
from cmsreduce.read.printed_numbers import rounding_of_digits

__all__ = ["PrintedRecords", "PrintedStrings", "is_printed_header"]

Ints = NDArray[np.int64]

# Bytes that are examined together.
_AT_ONCE = 4_000_000

_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{7}\d)(?P<rows>[ \d-]{7}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)(?P<name>.{0,8})(?P<format>.*)"
)
_WIDE_ASCII_HEADER = re.compile(
    r"(?P<cols>[ \d]{15}\d)(?P<rows>[ \d-]{15}\d)(?P<form>[ \d]{7}\d)(?P<type>[ \d]{7}\d)"
    r"(?P<name>.{8})(?P<format>.*)\|I16"
)
_NUMBER_FORMAT = re.compile(
    r"(?P<scale>1P,)?(?<!\d)(?P<count>[1-9]\d{0,2})[ED](?P<width>[1-9]\d{0,2})\.(?P<digits>\d{1,3})(?!\d)"
)


def is_printed_header(line: str) -> bool:
    """True for a line that is the header of a matrix in a formatted OUTPUT4 file."""
    line = line.rstrip()
    return bool(_WIDE_ASCII_HEADER.fullmatch(line)) or (
        (match := _ASCII_HEADER.fullmatch(line)) is not None
        and (not match["format"].strip() or _NUMBER_FORMAT.search(match["format"].upper()) is not None)
    )


@dataclass(frozen=True, eq=False)
class PrintedStrings:
    """Strings of numbers of a matrix, by the lines that they are printed on.

    Parameters
    ----------
    row, column : (k,) int64
        Place of the first number of each, counted from 0.
    count : (k,) int64
        Numbers in each.
    line : (k,) int64
        First line of each, counted from 0.
    """

    row: Ints
    column: Ints
    count: Ints
    line: Ints


class PrintedRecords:
    """Lines of a formatted file, by the counts in its column headers.

    Parameters
    ----------
    path : Path
        The file.

    Raises
    ------
    ReadError
        If the file ends early, a line is too short, or a size is absurd; with the line.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.content = path, FileBytes(path)
        self.number = 0
        self.place = ""
        content, size = self.content, len(self.content)
        newlines = [_newlines(content[start : start + _AT_ONCE]) + start for start in range(0, size, _AT_ONCE)]
        last = [size] if content[size - 1 : size] != b"\n" else []
        ends = np.concatenate([*newlines, np.array(last, dtype=np.int64)])
        starts = np.concatenate([[0], ends[:-1] + 1])
        # An array of Python is indexed one by one in a third of the time.
        self.starts, self.lengths = array("q", starts.tobytes()), array("q", (ends - starts).tobytes())

    def _line(self) -> bytes:
        """Next line; a ReadError if there is none."""
        if self.number >= len(self.starts):
            raise self._ended()
        start = self.starts[self.number]
        self.number += 1
        return self.content[start : start + self.lengths[self.number - 1]].rstrip(b"\r")

    def _ended(self) -> ReadError:
        return ReadError(
            f"{self.path}: the OP4 file is truncated: it ends after line {len(self.starts)} ({len(self.content)} "
            f"bytes), in {self.place}; write or copy it again"
        )

    def _integers(self, count: int) -> list[int]:
        """Integers of the next line, eight characters each; a single one may be wider."""
        line = self._line()
        try:
            return [int(line)] if count == 1 else [int(line[8 * k : 8 * k + 8]) for k in range(count)]
        except ValueError:
            raise ReadError(
                f"{self.path}, line {self.number}: '{line[:40].decode('latin-1')}' should be {count} integers, in "
                f"{self.place}; the OP4 file is truncated or damaged: write or copy it again"
            ) from None

    def matrices(self) -> Iterator[tuple[Op4Header, PrintedStrings]]:
        """Header and strings of every matrix, each after a check of all its lines."""
        while self.number < len(self.starts):
            line = self._line().decode("latin-1").rstrip()
            if not line:
                return
            yield self._matrix(line)

    def _matrix(self, line: str) -> tuple[Op4Header, PrintedStrings]:
        """Header of a matrix from its line, and its strings."""
        match = _WIDE_ASCII_HEADER.fullmatch(line) or _ASCII_HEADER.fullmatch(line)
        # The pattern allows a blank among the digits of a field.
        sizes = ("rows", "cols", "form", "type")
        if match is None or not is_printed_header(line) or any(" " in match[key].strip() for key in sizes):
            raise ReadError(
                f"{self.path}, line {self.number}: '{line[:40]}' should be the header of an OP4 matrix; the file is "
                "damaged: write or copy it again"
            )
        rows, cols, form, kind = (int(match[key]) for key in sizes)
        name = match["name"].strip(" \0")
        check_size(self.path, name, abs(rows), cols, len(self.content))
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
        found = array("q")
        try:
            for string in self._strings(header):
                found.extend(string)
        finally:
            # A short line shifts what follows it, so it is to blame before all else.
            row, column, number, first = np.array(found, dtype=np.int64).reshape(-1, 4).T
            self._refuse_short_lines(header, column, number, first)
        # The number behind the last column is none of the matrix.
        return header, PrintedStrings(row[:-1], column[:-1], number[:-1], first[:-1])

    def _strings(self, header: Op4Header) -> Iterator[tuple[int, int, int, int]]:
        """Row, column, count and line of strings from the next line on; a column beyond the last ends the matrix."""
        last, words_each = 0, header.words_each
        while True:
            self.place = f"matrix '{header.name}' after column {last} of {header.cols}"
            col, row, words = self._integers(3)
            if col > header.cols:
                yield 0, -1, 1, self._pass_numbers(1, header)
                return
            if col <= last or row < 0 or row > header.rows:
                raise ReadError(
                    f"{self.path}, line {self.number}: column {col}, row {row} is out of order in {self.place}; "
                    "the OP4 file is damaged: write or copy it again"
                )
            last = col
            if row > 0:
                yield row - 1, col - 1, words, self._pass_numbers(words, header)
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
                count = length // words_each
                yield first - 1, col - 1, count, self._pass_numbers(count, header)

    def _pass_numbers(self, count: int, header: Op4Header) -> int:
        """First line of the next numbers."""
        if count < 1:
            raise ReadError(
                f"{self.path}, line {self.number}: a string of {count} numbers in {self.place}; the OP4 file is damaged"
            )
        first = self.number
        self.number -= -count // header.per_line
        if self.number > len(self.starts):
            raise self._ended()
        return first

    def _refuse_short_lines(self, header: Op4Header, column: Ints, count: Ints, first: Ints) -> None:
        """Refuse a line that is too short for its numbers: it would shift all later ones."""
        lines = -(-count // header.per_line)
        string = np.repeat(np.arange(lines.size), lines)
        before = np.arange(string.size) - np.repeat(np.cumsum(lines) - lines, lines)
        line, share = first[string] + before, np.minimum(count[string] - before * header.per_line, header.per_line)
        length = np.frombuffer(self.lengths, dtype=np.int64)[line]
        short = np.flatnonzero(length < share * header.width)
        if short.size:
            at = short[0]
            raise ReadError(
                f"{self.path}, line {line[at] + 1}: holds {length[at]} characters where {share[at]} numbers of "
                f"{header.width} are expected, in matrix '{header.name}', column {column[string[at]] + 1}; the OP4 "
                "file is truncated or damaged: write or copy it again"
            )

    def numbers(self, header: Op4Header, strings: PrintedStrings) -> Iterator[tuple[slice, NDArray[np.float64]]]:
        """Some strings at a time, and their numbers one after the other.

        Raises
        ------
        ValueError
            With the first text that is no number, and its place.
        """
        starts, ends = np.frombuffer(self.starts, dtype=np.int64), np.cumsum(strings.count)
        lines = -(-strings.count // header.per_line)
        cuts = np.searchsorted(ends, np.arange(0, ends[-1] if ends.size else 0, _AT_ONCE // header.width), side="right")
        for i, j in pairwise([*np.unique(cuts), len(ends)]):
            count = strings.count[i:j]
            string = np.repeat(np.arange(i, j), count)
            within = np.arange(count.sum()) - np.repeat(ends[i:j] - count - (ends[i] - count[0]), count)
            line, place = np.divmod(within, header.per_line)
            begin, last = starts[strings.line[i]], strings.line[j - 1] + lines[j - 1] - 1
            text = self.content[begin : self.starts[last] + self.lengths[last]] + b" " * header.width
            at = starts[strings.line[string] + line] - begin + place * header.width
            fields = sliding_window_view(np.frombuffer(text, dtype=np.uint8), header.width)[at]
            values, sure = reals_of(fields)
            if not sure.all():
                bad = int(np.argmin(sure))
                where = f"column {strings.column[string[bad]] + 1}, row {strings.row[string[bad]] + within[bad] + 1}"
                raise ValueError(f"'{fields[bad].tobytes().decode('latin-1').strip()}' in {where} is not a number")
            yield slice(i, j), values


def _newlines(text: bytes) -> Ints:
    return np.flatnonzero(np.frombuffer(text, dtype=np.uint8) == ord("\n"))
