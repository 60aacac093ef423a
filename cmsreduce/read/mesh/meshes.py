"""Nodes and elements of a mesh that meshio reads, by the numbers of gmsh, Kratos and MED files or from 1."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.files import is_med
from cmsreduce.read.formats import Cells, Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import SINGLE
from cmsreduce.read.libraries import Arrays, arrays_of, cells_of
from cmsreduce.read.printed_numbers import coordinate_rounding, decimals

__all__ = ["MESH"]

# meshio's NASTRAN reader drops GRID coordinate systems and wide cards without a message.
_NASTRAN_SUFFIXES = {".bdf", ".nas", ".fem", ".dat", ".blk", ".pch", ".asm"}


def _mesh_geometry(path: Path) -> Geometry:
    """Nodes of a mesh, and its sets of nodes."""
    arrays = _arrays(path)
    points = arrays["points"]
    if points.ndim != 2 or not 1 <= points.shape[1] <= 3 or points.dtype.kind not in "fiu":
        raise ReadError(f"{path}: its points have no coordinates x, y, z; write the mesh again")
    xyz = np.zeros((len(points), 3))
    xyz[:, : points.shape[1]] = points
    rounding = coordinate_rounding(decimals(path, xyz))
    if points.dtype == np.float32:
        rounding = max(rounding, float(np.abs(xyz).max(initial=0.0)) * SINGLE)
    number = _numbers(arrays)
    named = {str(name): np.asarray(arrays[f"set {k}"], np.int64) for k, name in enumerate(arrays.get("names", ()))}
    if any(ids.min() < 0 or ids.max() >= number.size for ids in named.values()):
        raise ReadError(f"{path}: a set names a point that is not there; write the mesh again")
    # Python programs that read a mesh through meshio have its points in order of the file.
    mesh = Geometry.of_mesh(path, Nodes.in_basic(number, xyz, rounding), None if is_med(path) else number)
    return replace(mesh, node_sets={name: number[ids] for name, ids in named.items()})


def _mesh_cells(path: Path) -> Cells:
    """Elements of a mesh; none if the file is no mesh."""
    try:
        arrays = _arrays(path)
    except ReadError:
        return {}
    number = _numbers(arrays)
    found = cells_of(path, arrays)
    for kind, corners in found.items():
        for point in (int(corners.min()), int(corners.max())) if corners.size else ():
            if not 0 <= point < number.size:
                raise ReadError(f"{path}: a {kind} names point {point + 1} of {number.size}; write the mesh again")
    return {kind: number[corners] for kind, corners in found.items()}


def _numbers(arrays: Arrays) -> NDArray[np.int64]:
    """Numbers of the nodes: those of the file, or counted from 1 in its order."""
    return arrays.get("number", np.arange(1, len(arrays["points"]) + 1)).astype(np.int64)


def _arrays(path: Path) -> Arrays:
    """Points, cells by number and kind, and named sets, as they are read in a process of its own."""
    if path.suffix.lower() in _NASTRAN_SUFFIXES:
        raise ReadError(f"{path}: neither a NASTRAN deck (no GRID card) nor a mesh")
    kind = "med" if is_med(path) else "mesh"
    return arrays_of(path, kind, lambda reason: _no_mesh(path, reason))


def _no_mesh(path: Path, reason: str) -> ReadError:
    known = (
        "CalculiX .frd, Abaqus or CalculiX .inp, NASTRAN bulk data or external superelement, ANSYS .rst, .cdb or list "
        f"of nodes under a heading, universal files, {MESH.words}"
    )
    told = f". {reason.rstrip('.')}" if reason else ""
    return ReadError(
        f"{path}: no geometry in a format that is known: {known}{told}. If it is a mesh, write it as .vtu, or as "
        ".msh of gmsh"
    )


MESH = GeometryFormat(
    "mesh", "meshes of meshio (.msh, .vtu, .vtk, .xdmf) and MED", lambda head: True, _mesh_geometry, _mesh_cells
)
"""The format of last resort: every file that no other format takes."""
