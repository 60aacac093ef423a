"""A body read from its files: matrices, row labels, geometry, interfaces, and the proof that they fit together."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import SI, Damping, DofTable, FEModel, Source, Units
from cmsreduce.read.geometry import MESH_ROWS, Geometry, read_geometry
from cmsreduce.read.interfaces import InterfaceSpec, MatrixSource, resolve_interface
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.matrix import read_matrix, sha256_of
from cmsreduce.read.nastran import SET_NAMES
from cmsreduce.read.row_order import on_common_rows, possible_rows, prove_row_order

__all__ = ["read_body"]


def read_body(
    name: str,
    *,
    stiffness: MatrixSource,
    mass: MatrixSource,
    geometry: Path | None = None,
    rows: Path | str | None = None,
    damping: Damping | None = None,
    damping_matrix: MatrixSource | None = None,
    units: Units = SI,
    grounded: bool = False,
    interfaces: Mapping[str, InterfaceSpec] | None = None,
) -> FEModel:
    """Read an unreduced body and prove that its rows are the dofs they are said to be.

    Parameters
    ----------
    name : str
        Name of the body.
    stiffness, mass : MatrixSource
        Where its matrices are.
    geometry : Path, optional
        Deck, external superelement or mesh; needed for interfaces with positions and for the proof.
    rows : Path or str, optional
        What the rows are: a list of node.component, or the name of a dof set of the geometry. By default the labels
        in the matrix file, or else the set of the deck or the dofs of the mesh that have the size of the matrix.
    damping : Damping, optional
        Damping law.
    damping_matrix : MatrixSource, optional
        Viscous damping matrix, instead of a law.
    units : Units
        Unit system of the files; nothing is converted here.
    grounded : bool
        Whether the body is meant to be held to the ground, so that no proof is asked for.
    interfaces : mapping of str to InterfaceSpec
        Where joints attach.

    Returns
    -------
    FEModel

    Raises
    ------
    ReadError
        If a file is missing, damaged or of an unknown format, or a matrix is not in it.
    MatrixError
        If matrices are of different size, not square, not symmetric or not finite.
    DofMapError
        If the rows are unknown, or rigid motion of the geometry costs force.
    SceneError
        If an interface does not fit the body.
    """
    shape = None if geometry is None else read_geometry(Path(geometry))
    set_name, dof_list = _rows_asked_for(rows, shape)
    asked = [(stiffness, "stiffness"), (mass, "mass")]
    if damping_matrix is not None:
        asked.append((damping_matrix, "damping"))
    matrices = [read_matrix(Path(one.path), one.matrix, one.format, dof_list) for one, _ in asked]
    sources = _sources(matrices, [what for _, what in asked], shape, dof_list)

    def build(dofs: DofTable, wanted: Mapping[str, InterfaceSpec]) -> FEModel:
        table, placed = on_common_rows(name, dofs, matrices, shape)
        nodes = shape.nodes if shape is not None and len(shape.nodes) else None
        sets = {} if shape is None else _rows_of_sets(table, shape)
        faces = {face: resolve_interface(name, face, spec, table, nodes, sets) for face, spec in wanted.items()}
        return FEModel(
            name,
            placed[0].A,
            placed[1].A,
            table,
            nodes=nodes,
            interfaces=faces,
            damping=damping or Damping(),
            D=placed[2].A if len(placed) > 2 else None,
            units=units,
            rounding=max(one.rounding for one in matrices),
            sets=sets,
            constrained=_held(table, shape),
            grounded=grounded,
            sources=sources,
        )

    candidates = possible_rows(name, matrices[0], matrices[1], shape, set_name)
    dofs = candidates[0]
    if len(candidates) > 1:
        # An interface may be no part of the wrong sets, so sets are tried without.
        proven = (table for table in candidates if _in_order(build(table, {})))
        dofs = next(proven, dofs)
    body = build(dofs, interfaces or {})
    prove_row_order(body)
    return body


def _in_order(body: FEModel) -> bool:
    """Whether the row order is proven, or needs no proof."""
    try:
        prove_row_order(body)
    except DofMapError:
        return False
    return True


def _rows_asked_for(rows: Path | str | None, geometry: Geometry | None) -> tuple[str | None, Path | None]:
    """Name of a dof set, or file of a dof list."""
    if rows is None or isinstance(rows, Path):
        return None, rows
    named = rows in {*SET_NAMES, *MESH_ROWS, *(geometry.rows if geometry is not None else ())}
    # A word that is no file is a misspelt set, and the geometry can say which sets there are.
    word = geometry is not None and rows.isidentifier() and not Path(rows).exists()
    return (rows, None) if named or word else (None, Path(rows))


def _rows_of_sets(dofs: DofTable, geometry: Geometry) -> dict[str, NDArray[np.int64]]:
    """Rows of the sets that have all their dofs among the rows."""
    found = {name: dofs.rows(table.node, table.component) for name, table in geometry.sets.items()}
    return {name: rows for name, rows in found.items() if rows.size and (rows >= 0).all()}


def _held(dofs: DofTable, geometry: Geometry | None) -> DofTable | None:
    """Constrained dofs without rows; a constrained dof that has a row is free in these matrices."""
    if geometry is None or geometry.constrained is None:
        return None
    table = geometry.constrained
    gone = dofs.rows(table.node, table.component) < 0
    return DofTable(table.node[gone], table.component[gone]) if gone.any() else None


def _sources(
    matrices: list[LabelledMatrix], what: list[str], geometry: Geometry | None, dof_list: Path | None
) -> tuple[Source, ...]:
    """Every file read, with its hash."""
    holds = [(one.path, f"{letter} {one.name}") for one, letter in zip(matrices, what, strict=True)]
    holds += [(path, "geometry") for path in (geometry.files if geometry is not None else ())]
    if dof_list is not None:
        holds.append((dof_list, "row order"))
    hashes = {path: sha256_of(path) for path, _ in holds}
    return tuple(Source(str(path), hashes[path], said) for path, said in holds)
