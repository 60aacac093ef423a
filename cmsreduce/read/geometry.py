"""Geometry files of any registered format: nodes, the dofs that matrix rows may be, and elements for pictures.

meshio reads every file that no registered format takes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.read.ansys import NODE_FILE, NODE_LISTING
from cmsreduce.read.calculix_abaqus import FRD, INPUT_FILE
from cmsreduce.read.files import read_head, reading
from cmsreduce.read.formats import Cells, Geometry, GeometryFormat
from cmsreduce.read.mesh import MESH, UNIVERSAL
from cmsreduce.read.nastran import BULK_DATA, EXTERNAL_SUPERELEMENT

__all__ = ["GEOMETRY_FORMATS", "read_cells", "read_geometry"]

GEOMETRY_FORMATS: dict[str, GeometryFormat] = {
    format.name: format
    for format in (FRD, NODE_FILE, UNIVERSAL, INPUT_FILE, EXTERNAL_SUPERELEMENT, BULK_DATA, NODE_LISTING)
}
"""Every registered format of geometry files by name, in the order of detection."""

_HEAD = 1 << 20  # bytes that detection examines


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
    format = _format_of(path)
    try:
        with reading(path, "its nodes"):
            found = format.read(path)
    except DofMapError as error:
        raise ReadError(f"{path}: {error}") from error
    lost = ~np.isfinite(found.nodes.xyz).all(axis=1)
    if lost.any():
        raise ReadError(
            f"{path}: the coordinates of node {found.nodes.id[lost][0]} are not finite; the file is damaged, or the "
            "program that wrote it had no place for the node: write it again"
        )
    return found


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
    return next((format for format in GEOMETRY_FORMATS.values() if format.detect(head)), MESH)
