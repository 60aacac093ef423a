"""Nodes and elements of ANSYS result files (.rst) and archives (.cdb), through the library ansys-mapdl-reader."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.ansys.full_file import RESULT, binary_kind, library_refused
from cmsreduce.read.formats import Geometry, GeometryFormat, StatedLength
from cmsreduce.read.libraries import Arrays, arrays_of, cells_of
from cmsreduce.read.printed_numbers import coordinate_rounding, decimals

__all__ = ["NODE_FILE"]

_NODE_BLOCK = re.compile(r"^NBLOCK\s*,", re.IGNORECASE | re.MULTILINE)

_UNITS = re.compile(r"^[^\S\n]*/UNITS\s*,\s*(\w+)", re.IGNORECASE | re.MULTILINE)
# Metres by the label of the command /UNITS.
_LENGTHS = {"SI": 1.0, "MKS": 1.0, "UMKS": 1e-6, "CGS": 1e-2, "MPA": 1e-3, "BFT": 0.3048, "BIN": 0.0254}


def _arrays(path: Path) -> Arrays:
    return arrays_of(path, "ansys-nodes", lambda reason: library_refused(path, reason))


def _read_nodes(path: Path) -> Geometry:
    """Nodes of a file, along the basic axes.

    Raises
    ------
    ReadError
        If there are no nodes, or displacements of a node are along axes of its own.
    """
    arrays = _arrays(path)
    number = arrays["number"].astype(np.int64)
    xyz = arrays["points"].astype(np.float64).reshape(-1, 3)
    turned = np.flatnonzero(np.any(arrays["angles"] != 0, axis=-1))
    if turned.size:
        raise ReadError(
            f"{path}: the displacements of {turned.size} nodes are along turned axes, the first is node "
            f"{number[turned[0]]}, and such axes are not read yet; turn them back (CSYS,0 and NROTAT,ALL) and write "
            "matrices and nodes again"
        )
    if not number.size:
        raise ReadError(f"{path}: there are no nodes in it; write them with CDWRITE,DB")
    return Geometry.of_mesh(path, Nodes.in_basic(number, xyz, coordinate_rounding(decimals(path, xyz))))


def _stated_length(head: str) -> StatedLength | None:
    found = _UNITS.search(head)
    metres = None if found is None else _LENGTHS.get(found[1].upper())
    return None if found is None or metres is None else StatedLength(metres, f"/UNITS,{found[1]}")


NODE_FILE = GeometryFormat(
    "ansys",
    "ANSYS .rst or .cdb",
    lambda head: binary_kind(head[:12].encode("latin-1")) == RESULT or _NODE_BLOCK.search(head) is not None,
    _read_nodes,
    lambda path: cells_of(path, _arrays(path)),
    "name the .full file, or the text files of HBMAT (Mapping = YES) or of *SMAT and *EXPORT",
    length=_stated_length,
)
