"""Geometry files of any registered format: nodes, the dofs that matrix rows may be, and elements for pictures.

meshio reads every file that no registered format takes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import SCALAR, DofTable, Nodes, Units, units_of
from cmsreduce.read.calculix_abaqus import expansion_beside
from cmsreduce.read.file_kind import GEOMETRY_HEAD, FileKind, file_kind, geometry_format
from cmsreduce.read.files import read_head, reading, require_file
from cmsreduce.read.formats import Cells, Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.marks import UNREAD_MESHES
from cmsreduce.read.mesh import MESH
from cmsreduce.read.stated import StatedEnergy, StatedMass

__all__ = ["deck_statement", "in_terms_of", "other_length", "read_cells", "read_geometry", "read_unmarked"]

# Files state factors between units with four digits or more.
_SAME_UNIT = 1e-3
_TRANSLATIONS = 3


def read_geometry(path: Path) -> Geometry:
    """Read the geometry of a body; the format is found by content.

    Parameters
    ----------
    path : Path
        File of a format in ``GEOMETRY_FORMATS``, or a mesh that meshio reads.

    Returns
    -------
    Geometry
        With the node ids of the file; where it has none, its nodes count from 1 in order of the file.

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
    if found.nodes.id.min(initial=1) < 1:
        raise ReadError(
            f"{path}: there is a node {found.nodes.id.min()}, but nodes count from 1: number them anew, here and in "
            "`rows:` where a list names them"
        )
    lost = ~np.isfinite(found.nodes.xyz).all(axis=1)
    if lost.any():
        raise ReadError(
            f"{path}: the coordinates of node {found.nodes.id[lost][0]} are not finite; the file is damaged, or the "
            "program that wrote it had no place for the node: write it again"
        )
    head = read_head(path, GEOMETRY_HEAD, f"{path}: the geometry").decode("latin-1")
    return replace(found, length=format.length(head.replace("\r", "")))


def read_unmarked(path: Path, kind: FileKind) -> Geometry:
    """Read the geometry of a file that may hold anything; one of unknown kind may be a mesh without a mark.

    Raises
    ------
    ReadError
        As of ``read_geometry``; of a file of unknown kind with what to do if it holds matrices.
    """
    try:
        return read_geometry(path)
    except ReadError as error:
        if kind.name != "unknown":
            raise
        raise ReadError(f"{str(error).rstrip('.')}. {kind.step}") from error


def other_length(body: str, shape: Geometry, units: Units) -> tuple[str, ...]:
    """Remark on a body whose geometry states another unit of length than that in which the body is read.

    Parameters
    ----------
    body : str
        Name of the body.
    shape : Geometry
        Its geometry.
    units : Units
        Unit system of its files, by the keys.
    """
    stated = shape.length
    if stated is None or math.isclose(stated.metres, units.length, rel_tol=_SAME_UNIT):
        return ()
    lengths = units_of("length").items()
    names = (name for name, value in lengths if math.isclose(value, stated.metres, rel_tol=_SAME_UNIT))
    said = next(names, f"units of {stated.metres:.6g} m")
    return (
        f"{body}: {shape.path} states coordinates in {said} ({stated.where}), and the body is read in {units.name}: "
        f"set `units:` of the component to the system of its files, or write the coordinates in {units.length_name}",
    )


def in_terms_of(geometry: Geometry | None, matrix: LabelledMatrix) -> LabelledMatrix:
    """The matrix with the dofs that its labels mean in a geometry.

    CalculiX labels rotations as components 1..3 of a number of their own. It numbers the dofs that it adds inside
    elements after all nodes of the deck; they are scalar. A scalar point of NASTRAN may have 1 as its component, and
    so may a mode of a superelement: a number without a place, and without another row.
    """
    if geometry is None or matrix.dofs is None:
        return matrix
    node, component = matrix.dofs.node.copy(), matrix.dofs.component.copy()
    if matrix.format == "dmig":
        scalar = [table.node[table.component == SCALAR] for table in geometry.rows.values()]
        component[(component == 1) & np.isin(node, np.concatenate([*scalar, node[:0]]))] = SCALAR
    if matrix.format != "calculix":
        numbers, place, count = np.unique(node, return_inverse=True, return_counts=True)
        placed = geometry.nodes.index(numbers) >= 0
        # Where nodes have one row each, a number without a place is a node that the deck lacks.
        if (count[placed] > 1).any():
            component[(component == 1) & ((count == 1) & ~placed)[place]] = SCALAR
        return replace(matrix, dofs=DofTable(node, component))
    if not len(geometry.nodes):
        return matrix
    for turn, of in geometry.turning.items():
        rows = np.flatnonzero((matrix.dofs.node == turn) & (component > SCALAR) & (component <= _TRANSLATIONS))
        node[rows], component[rows] = of, component[rows] + _TRANSLATIONS
    inner = np.flatnonzero((component > SCALAR) & (node > max(geometry.nodes.id.max(), *geometry.turning, 0)))
    component[inner] = SCALAR
    lacking = np.unique(node[(component > SCALAR) & (geometry.nodes.index(node) < 0)])
    if lacking.size and (expansion := expansion_beside(matrix.path)) is not None:
        raise DofMapError(
            f"{geometry.path}: {lacking.size} nodes with rows in {matrix.path} have no place in it, the first is "
            f"{lacking[0]}: CalculiX expanded shells or beams to solids ({expansion.path}), and a result file leaves "
            "out the nodes of knots, loads and equations. Give the .inp file of this job as `geometry:`"
        )
    node[inner] = node.max(initial=0) + 1 + np.arange(inner.size)
    return replace(matrix, dofs=DofTable(node, component))


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


def deck_statement(
    path: Path, nodes: Nodes, moving: NDArray[np.bool_]
) -> tuple[StatedMass | None, StatedEnergy | None]:
    """Mass and strain energy that the elements and materials of a deck state, from one reading.

    Parameters
    ----------
    path : Path
        File as of ``read_geometry``.
    nodes : Nodes
        Its nodes.
    moving : (N,) bool
        True for the nodes that have rows; the energy leaves out elements on others.

    Returns
    -------
    StatedMass and StatedEnergy, each or None
        In the units of the deck. None where the file does not state it fully.
    """
    return _format_of(path).states(path, nodes, moving)


def _format_of(path: Path) -> GeometryFormat:
    require_file(path)
    head = read_head(path, GEOMETRY_HEAD, f"{path}: the geometry")
    found = geometry_format(head)
    if found is not None:
        return found
    kind = file_kind(path)
    # meshio reads meshes that have no mark, and finds their formats by the name.
    if kind.geometry or kind.name == "unknown":
        return MESH
    step = "name the deck or mesh that the matrices were made from" if kind.matrices else kind.step
    lack = "whose nodes are not read" if kind.name in UNREAD_MESHES else "which holds no nodes"
    raise ReadError(f"{path}: this is {kind.words}, {lack}" + (f": {step}" if step else ""))
