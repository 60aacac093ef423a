"""Nodes and elements of universal files (.unv, .uff), through the library pyuff.

The library is an extra: ``pip install cmsreduce[uff]``.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.files import read_head, require_file
from cmsreduce.read.formats import Geometry, GeometryFormat, StatedLength
from cmsreduce.read.libraries import Arrays, arrays_of, cells_of
from cmsreduce.read.printed_numbers import coordinate_rounding, decimals, real_number

__all__ = ["UNIVERSAL", "universal_arrays"]

# The mark of a dataset, then its number.
# Neutral files of Femap have such blocks, too; their first one is 100.
_START = re.compile(r"\s*-1[^\S\n]*\n[^\S\n]*(?!100\s)\d{2,5}[bB]?\s")
# The line before and behind each dataset, and what pyuff takes for it: the end of a line of numbers, too.
_LINE, _TAKEN = re.compile(rb"^ {4}-1[ \t]*\r?$", re.MULTILINE), re.compile(rb" {4}-1(?=[\r\n]|\Z| {74})")
# Dataset 164: code and description of the units, then how many of them a metre, a newton and a kelvin are, in
# columns of 25.
_UNITS = re.compile(r"^[^\S\n]*-1[^\S\n]*\n[^\S\n]*164[^\S\n]*\n[^\n]*\n([^\n]{1,25})", re.MULTILINE)
# Axes are printed with sixteen digits.
_ALONG_BASIC = 1e-12


def universal_arrays(path: Path) -> Arrays:
    """Nodes, axes, elements and modes of a universal file, as the library reads them.

    Raises
    ------
    ReadError
        If the library is missing or cannot read the file, or if the library would leave a dataset out.
    """
    require_file(path)
    content = read_head(path, path.stat().st_size)
    lines, taken = len(_LINE.findall(content)), len(_TAKEN.findall(content))
    if lines % 2:
        raise ReadError(f"{path}: the universal file is truncated: its last dataset has no end; write or copy it again")
    if taken != lines:
        raise ReadError(
            f"{path}: a line of numbers ends with -1, which pyuff takes for the end of a dataset; write the nodes, "
            "elements and modes without the dataset of that line"
        )
    return arrays_of(path, "universal", lambda reason: _refused(path, reason))


def _refused(path: Path, reason: str) -> ReadError:
    if "No module named" in reason:
        return ReadError(
            f"{path}: universal files are read by the library pyuff, which is not installed ({reason}): "
            "pip install 'cmsreduce[uff]'"
        )
    return ReadError(f"{path}: pyuff cannot read the universal file: {reason}; it is damaged: write or copy it again")


def _read_nodes(path: Path) -> Geometry:
    """Nodes of datasets 15 and 2411, along the basic axes.

    Raises
    ------
    ReadError
        If there are no nodes, or displacements of a node are along axes of its own.
    """
    arrays = universal_arrays(path)
    number = arrays["node_nums"].astype(np.int64)
    if not number.size:
        raise ReadError(f"{path}: there are no nodes in it (dataset 15 or 2411); write the geometry into the file")
    xyz = np.column_stack([arrays[axis].astype(np.float64) for axis in "xyz"])
    turned = np.abs(arrays["axes"].astype(np.float64) - np.eye(3)).max(axis=(1, 2), initial=0.0) > _ALONG_BASIC
    own = np.flatnonzero(np.isin(arrays["disp_cs"], arrays["systems"][turned]))
    if own.size:
        raise ReadError(
            f"{path}: the displacements of {own.size} nodes are along turned axes (dataset 2420), the first is node "
            f"{number[own[0]]}, and such axes are not read yet; write matrices and nodes along the basic axes"
        )
    return Geometry.of_mesh(path, Nodes.in_basic(number, xyz, coordinate_rounding(decimals(path, xyz))))


def _stated_length(head: str) -> StatedLength | None:
    found = _UNITS.search(head)
    factor = None if found is None or not found[1].strip() else real_number(found[1].split()[0])
    return StatedLength(1 / factor, f"dataset 164: {factor:g} a metre") if factor is not None and factor > 0 else None


UNIVERSAL = GeometryFormat(
    "universal",
    "universal files (.unv, .uff)",
    lambda head: _START.match(head.replace("\r", "")) is not None,
    _read_nodes,
    lambda path: cells_of(path, universal_arrays(path)),
    length=_stated_length,
)
