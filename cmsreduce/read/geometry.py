"""Geometry files of any registered format: nodes, the dofs that matrix rows may be, and elements for pictures.

meshio reads every file that no registered format takes.
"""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus import FRD, INPUT_FILE
from cmsreduce.read.files import LIBRARY_ERRORS, read_head, reading
from cmsreduce.read.formats import CELL_CORNERS, Cells, Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import SINGLE
from cmsreduce.read.nastran import BULK_DATA, EXTERNAL_SUPERELEMENT
from cmsreduce.read.printed_numbers import coordinate_rounding

__all__ = ["GEOMETRY_FORMATS", "read_cells", "read_geometry"]

GEOMETRY_FORMATS: dict[str, GeometryFormat] = {
    format.name: format for format in (FRD, INPUT_FILE, EXTERNAL_SUPERELEMENT, BULK_DATA)
}
"""Every registered format of geometry files by name, in the order of detection."""

_HEAD = 1 << 20  # bytes that detection examines
# meshio's NASTRAN reader drops GRID coordinate systems and wide cards without a message.
_NASTRAN_SUFFIXES = {".bdf", ".nas", ".fem", ".dat", ".blk", ".pch", ".asm"}


def read_geometry(path: Path) -> Geometry:
    """Read the geometry of a body; the format is found by content.

    Parameters
    ----------
    path : Path
        File of a format in ``GEOMETRY_FORMATS``, or a mesh that meshio reads.

    Returns
    -------
    Geometry
        With the node ids of the file; meshio has none, so its nodes count from 1 in order of the file.

    Raises
    ------
    ReadError
        If the file is missing, damaged or of an unknown format.
    """
    return _format_of(path).read(path)


def read_cells(path: Path) -> Cells:
    """Read the elements of a deck or a mesh: corner nodes only, for pictures.

    Parameters
    ----------
    path : Path
        File as of ``read_geometry``.

    Returns
    -------
    dict of cell kind to (k, corners) int64
        Node ids; empty where the file holds no element that can be drawn.

    Raises
    ------
    ReadError
        If the file cannot be opened or is damaged.
    """
    format = _format_of(path)
    with reading(path, "its elements"):
        return format.cells(path)


def _format_of(path: Path) -> GeometryFormat:
    head = read_head(path, _HEAD, f"{path}: the geometry").decode("latin-1")
    return next((format for format in GEOMETRY_FORMATS.values() if format.detect(head)), _MESH)


def _meshio_geometry(path: Path) -> Geometry:
    """Nodes by meshio, numbered from 1."""
    if path.suffix.lower() in _NASTRAN_SUFFIXES:
        raise ReadError(f"{path}: neither a NASTRAN deck (no GRID card) nor a mesh")
    points = np.asarray(_meshio_read(path).points)
    if points.ndim != 2 or points.shape[1] > 3:
        raise ReadError(f"{path}: its points have no coordinates x, y, z; write the mesh again")
    xyz = np.zeros((len(points), 3))
    xyz[:, : points.shape[1]] = points
    rounding = coordinate_rounding(xyz)
    if points.dtype == np.float32:
        rounding = max(rounding, float(np.abs(xyz).max(initial=0.0)) * SINGLE)
    return Geometry.of_mesh(path, Nodes.in_basic(np.arange(1, len(xyz) + 1), xyz, rounding))


def _meshio_cells(path: Path) -> Cells:
    try:
        blocks = _meshio_read(path).cells
    except ReadError:
        return {}
    found: dict[str, list[NDArray[np.int64]]] = {}
    for block in blocks:
        kind = next((name for name in CELL_CORNERS if block.type.startswith(name)), None)
        if kind is not None and kind != "vertex":
            found.setdefault(kind, []).append(np.asarray(block.data, dtype=np.int64)[:, : CELL_CORNERS[kind]] + 1)
    return {kind: np.vstack(parts) for kind, parts in found.items()}


def _meshio_read(path: Path) -> Any:
    import meshio

    complaint = io.StringIO()
    try:
        # meshio prints, and exits the program, on a file that it cannot read.
        with contextlib.redirect_stdout(complaint), contextlib.redirect_stderr(complaint):
            return meshio.read(path)
    except (SystemExit, meshio.ReadError, *LIBRARY_ERRORS) as error:
        reason = " ".join(complaint.getvalue().split()) or str(error)
        known = ", ".join(format.words for format in (*GEOMETRY_FORMATS.values(), _MESH))
        raise ReadError(f"{path}: no geometry in a format that is known: {known}. {reason}") from error


_MESH = GeometryFormat(
    "mesh", "meshes of meshio (.msh, .vtu, .vtk, .xdmf, .med)", lambda head: True, _meshio_geometry, _meshio_cells
)
