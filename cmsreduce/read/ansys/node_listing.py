"""Text tables of nodes: the export of ANSYS Mechanical, NLIST and *VWRITE of ANSYS, and other lists ``node x y z``.

Mechanical writes the decimal sign of the user's country, so ``0,15`` between tabs is a number.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes, units_of
from cmsreduce.read.files import read_text
from cmsreduce.read.formats import Geometry, GeometryFormat, StatedLength
from cmsreduce.read.printed_numbers import coordinate_rounding, real_number, rounding_of_digits

__all__ = ["NODE_LISTING"]

# X, Y and Z as words of their own, as in "NODE X Y Z" and "Node Number, X Location (m), ...".
_HEADING = re.compile(r"(?i)(?<![a-z])x(?![a-z]).*(?<![a-z])y(?![a-z]).*(?<![a-z])z(?![a-z])")
_HEADING_LINES = 40
# The unit in "X Location (mm)".
_UNIT = re.compile(r"(?i)(?<![a-z])x(?![a-z])[^()\n]{0,20}\(([a-z]{1,4})\)")
# No line of a list is longer; patterns with blanks on both sides of a separator take the square of a length.
_LONGEST_LINE = 1000
_DECIMAL = re.compile(r"[+-]?\d*\.\d*(?:[EeDd][+-]?\d+)?")
_ID = re.compile(r"\d{1,15}")
# Tabs and semicolons separate whatever the decimal sign is; a comma separates only where blanks do not.
_SEPARATORS = (re.compile(r"\s*[\t;]\s*"), re.compile(r"\s+"), re.compile(r"\s*,\s*"))
# NLIST prints five digits.
_NLIST_DIGITS = 5

Row = tuple[int, list[float], list[str]]


def _row(line: str, separator: re.Pattern[str]) -> Row | None:
    """Node id, the numbers after it, and their texts; None if the line is something else."""
    if len(line) > _LONGEST_LINE:
        return None
    fields = separator.split(line.strip().strip(";\t"))
    decimal = separator is not _SEPARATORS[-1]
    if len(fields) < 4 or not _ID.fullmatch(fields[0]):
        return None
    texts = [field.replace(",", ".") if decimal else field for field in fields[1:] if field]
    known = [number for number in map(real_number, texts) if number is not None]
    return (int(fields[0]), known, texts) if len(known) == len(texts) >= 3 else None


def _separator(line: str) -> re.Pattern[str] | None:
    """The separator by which a line is a node; None if it is no node."""
    return next((each for each in _SEPARATORS if _row(line, each) is not None), None)


def _is_listing(head: str) -> bool:
    """True if a heading that names x, y and z stands right above a node, or all lines are nodes in ascending order."""
    above = ""
    lines = list(islice((line for line in head.splitlines() if line.strip()), _HEADING_LINES))
    for line in lines:
        if _separator(line) is not None:
            headed = len(above) <= _LONGEST_LINE and _HEADING.search(above) is not None
            return headed or (not above and _all_nodes(lines))
        above = line
    return False


def _all_nodes(lines: Sequence[str]) -> bool:
    """True if every line is a number and three coordinates with a decimal sign, and the numbers ascend."""
    last = 0
    # The last line of a head may be cut.
    for line in lines[:-1] or lines:
        words = line.replace(",", " ").split()
        if len(words) != 4 or not all(_DECIMAL.fullmatch(word) for word in words[1:]):
            return False
        if not _ID.fullmatch(words[0]) or int(words[0]) <= last:
            return False
        last = int(words[0])
    return True


def _read_listing(path: Path) -> Geometry:
    """Nodes of a table, in order of the file, along the basic axes.

    Raises
    ------
    ReadError
        If a line is no node, or a node is turned (its displacements are along axes of its own).
    """
    ids: list[int] = []
    numbers: list[list[float]] = []
    texts: list[str] = []
    heading: set[str] = set()
    separator = None
    for at, line in enumerate(read_text(path).splitlines(), start=1):
        separator = separator or _separator(line)
        if separator is None:
            heading.add(line.strip())
            continue
        # NLIST repeats its heading on every page.
        if not line.strip() or line.strip() in heading:
            continue
        row = _row(line, separator)
        if row is None or len(row[1]) not in (3, 6):
            raise ReadError(
                f"{path}, line {at}: '{line.strip()[:60]}' is no node: number, x, y, z. If it is the heading of a "
                "page, list the nodes without pages (/PAGE,,,1E9)"
            )
        ids.append(row[0])
        numbers.append(row[1])
        texts += row[2][:3]
        if any(row[1][3:]):
            raise ReadError(
                f"{path}, line {at}: the displacements of node {row[0]} are along turned axes (THXY, THYZ, THZX), "
                "which are not read from a listing; give a .cdb or .rst file as geometry"
            )
    xyz = np.array([row[:3] for row in numbers]).reshape(-1, 3)
    rounding = coordinate_rounding(texts)
    if any(len(row) > 3 for row in numbers):
        largest = float(np.abs(xyz).max(initial=0.0))
        decade = 10.0 ** math.ceil(math.log10(largest)) if largest else 0.0
        rounding = max(rounding, decade * rounding_of_digits(_NLIST_DIGITS))
    return Geometry.of_mesh(path, Nodes.in_basic(ids, xyz, rounding))


def _stated_length(head: str) -> StatedLength | None:
    """Unit of the heading right above the nodes, as Mechanical writes it."""
    lines = islice(head.splitlines(), _HEADING_LINES)
    found = next((match for line in lines if (match := _UNIT.search(line[:_LONGEST_LINE])) is not None), None)
    metres = None if found is None else units_of("length").get(found[1])
    return None if found is None or metres is None else StatedLength(metres, found[0].strip())


NODE_LISTING = GeometryFormat(
    "node-listing",
    "table 'node x y z' (ANSYS Mechanical, NLIST, *VWRITE)",
    _is_listing,
    _read_listing,
    lambda path: {},
    length=_stated_length,
)
