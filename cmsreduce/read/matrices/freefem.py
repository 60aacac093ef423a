"""Sparse matrices as FreeFEM 4 prints them: ``ofstream f("K.txt"); f << K;``.

Two lines of comments come first, then rows, columns and entries, a mark of symmetric matrices, of which the lower
triangle is there, and a mark of indices that count from 1; then an entry a line.
"""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_head, read_lines
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, check_size, mirrored
from cmsreduce.read.matrices.matrix_market import COORDINATE, read_entries
from cmsreduce.read.printed_numbers import rounding_of_printed, whole_number

__all__ = ["FREEFEM", "PLANE_FREEFEM"]

_NUMBER, _DECIMAL, _LABEL = rb"[-+.\deE]++[ \t]++", rb"[-+]?\d*+\.[\deE+-]*+", rb"\d++[ \t]*+\r?\n"
PLANE_FREEFEM = (
    rb"\A[ \t]*+\d++(?:[ \t]++\d++){2}[ \t]*+\r?\n"
    rb"(?:[ \t]*+" + 2 * _NUMBER + _LABEL + rb"){0,99}?"
    rb"[ \t]*+(?:" + _NUMBER + _DECIMAL + rb"|" + _DECIMAL + rb"[ \t]++[-+.\deE]++)[ \t]++" + _LABEL
)
"""The start of a plane mesh: counts, then x, y and a label of each node; no entry of a matrix has a decimal index."""

_START = re.compile(rb"#[ \t]*HashMatrix Matrix \(COO\)")
_HEAD = re.compile(rb"#[^\n]*\n[ \t]*#[^\n]*\n([ \t\d]*)\r?\n")
_COUNTS = 5
_LONGEST_HEAD = 4096


def _matrices(path: Path) -> list[StoredMatrix]:
    """The one matrix of a file.

    Raises
    ------
    ReadError
        If the line of counts is missing. Loading raises it if entries are missing, complex or out of range.
    """
    head = _HEAD.match(read_head(path, _LONGEST_HEAD))
    counts = [whole_number(word.decode()) for word in head[1].split()][:_COUNTS] if head else []
    if len(counts) < _COUNTS or None in counts:
        raise ReadError(
            f"{path}: the third line of a matrix of FreeFEM has rows, columns, entries and marks; this file is "
            "truncated or of another version: write it again with FreeFEM 4"
        )
    rows, cols, entries, half, first = (count or 0 for count in counts)
    check_size(path, path.stem, rows, cols, path.stat().st_size)
    load = partial(_load, path, (rows, cols, entries), half > 0, min(first, 1))
    return [StoredMatrix(path.stem, "real, as text", "symmetric" if half else "", (rows, cols, entries), load)]


def _load(path: Path, size: tuple[int, int, int], half: bool, first: int) -> LabelledMatrix:
    """Read the entries of a matrix, whose rows count from ``first``."""
    rows, cols, entries = size
    text = read_lines(path)
    head = _HEAD.match(text)
    assert head is not None
    # Empty lines in place of the head, so that messages have the numbers of lines.
    where, value, printed = read_entries(path, b"\n" * 3 + text[head.end() :], COORDINATE)
    where = where - first
    if len(value) != entries or where.min() < 0 or (where.max(axis=0) >= (rows, cols)).any():
        raise ReadError(
            f"{path}: its head says {entries} entries in {rows} x {cols}, and there are {len(value)} in rows "
            f"{where[:, 0].min() + 1} to {where[:, 0].max() + 1}; it is truncated or damaged: write or copy it again"
        )
    A = canonical(where[:, 0], where[:, 1], value, (rows, cols))
    return LabelledMatrix(mirrored(A) if half else A, path.stem, path, FREEFEM.name, rounding_of_printed(printed))


FREEFEM = MatrixFormat("freefem", "FreeFEM", lambda path, head: _START.match(head) is not None, _matrices, named=False)
