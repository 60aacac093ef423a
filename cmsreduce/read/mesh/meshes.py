"""Nodes and elements of a mesh that meshio reads, numbered from 1 in order of the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.formats import CELL_CORNERS, Cells, Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import SINGLE
from cmsreduce.read.libraries import Arrays, arrays_of
from cmsreduce.read.printed_numbers import coordinate_rounding

__all__ = ["MESH"]

# meshio's NASTRAN reader drops GRID coordinate systems and wide cards without a message.
_NASTRAN_SUFFIXES = {".bdf", ".nas", ".fem", ".dat", ".blk", ".pch", ".asm"}


def _mesh_geometry(path: Path) -> Geometry:
    """Nodes of a mesh."""
    points = _arrays(path)["points"]
    if points.ndim != 2 or not 1 <= points.shape[1] <= 3 or points.dtype.kind not in "fiu":
        raise ReadError(f"{path}: its points have no coordinates x, y, z; write the mesh again")
    xyz = np.zeros((len(points), 3))
    xyz[:, : points.shape[1]] = points
    rounding = coordinate_rounding(xyz)
    if points.dtype == np.float32:
        rounding = max(rounding, float(np.abs(xyz).max(initial=0.0)) * SINGLE)
    return Geometry.of_mesh(path, Nodes.in_basic(np.arange(1, len(xyz) + 1), xyz, rounding))


def _mesh_cells(path: Path) -> Cells:
    """Elements of a mesh; none if the file is no mesh."""
    try:
        arrays = _arrays(path)
    except ReadError:
        return {}
    nodes = len(arrays["points"])
    found: dict[str, list[NDArray[np.int64]]] = {}
    for name, data in arrays.items():
        kind = next((kind for kind in CELL_CORNERS if name.partition(" ")[2].startswith(kind)), None)
        if kind is None or kind == "vertex" or data.ndim != 2 or data.shape[1] < CELL_CORNERS[kind]:
            continue
        corners = data[:, : CELL_CORNERS[kind]]
        if corners.dtype.kind not in "iu":
            raise ReadError(f"{path}: a {kind} names its points by {corners.dtype} numbers; write the mesh again")
        # Python's integers have no largest one: a damaged number may be the largest of its type.
        for point in (int(corners.min(initial=0)), int(corners.max(initial=0))) if corners.size else ():
            if not 0 <= point < nodes:
                raise ReadError(f"{path}: a {kind} names point {point + 1} of {nodes}; write the mesh again")
        found.setdefault(kind, []).append(corners.astype(np.int64) + 1)
    return {kind: np.vstack(parts) for kind, parts in found.items()}


def _arrays(path: Path) -> Arrays:
    """Points, and cells by number and kind, as meshio reads them in a process of its own."""
    if path.suffix.lower() in _NASTRAN_SUFFIXES:
        raise ReadError(f"{path}: neither a NASTRAN deck (no GRID card) nor a mesh")
    return arrays_of(path, "mesh", lambda reason: _no_mesh(path, reason))


def _no_mesh(path: Path, reason: str) -> ReadError:
    return ReadError(
        f"{path}: no geometry in a format that is known: CalculiX .frd, Abaqus or CalculiX .inp, NASTRAN bulk data or "
        f"external superelement, {MESH.words}. {reason}".rstrip()
    )


MESH = GeometryFormat(
    "mesh", "meshes of meshio (.msh, .vtu, .vtk, .xdmf, .med)", lambda head: True, _mesh_geometry, _mesh_cells
)
"""The format of last resort: every file that no other format takes."""
