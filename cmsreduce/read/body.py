"""Bodies from their files: matrices, the dofs of their rows, geometry, interfaces, and proof of the row order."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, SceneError
from cmsreduce.model import SCALAR, SI, Damping, DofTable, FEModel, Source, Units, rounding_of_values
from cmsreduce.read.files import sha256_of
from cmsreduce.read.formats import Geometry
from cmsreduce.read.geometry import in_terms_of, other_length, read_geometry
from cmsreduce.read.idle_turns import with_idle_turns
from cmsreduce.read.interfaces import InterfaceSpec, MatrixSource, resolve_interface
from cmsreduce.read.labelled_matrix import LabelledMatrix, require_square
from cmsreduce.read.matrix import read_matrix
from cmsreduce.read.row_order import prove_row_order, without_round_off
from cmsreduce.read.rows import (
    constrained_dofs,
    on_common_rows,
    possible_rows,
    set_or_list,
    with_all_modes,
    with_places,
    with_turned_supports,
    without_support_rows,
)

__all__ = ["read_body"]

_NAMED = 5
_LAST_NUMBERS = (
    ". Rows with numbers beyond those of the geometry were taken as dofs inside elements; a rigid body (*RIGID BODY, "
    "*COUPLING) has such rows too, and then the geometry must be the .inp file"
)


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
    rows_trusted: bool = False,
    interfaces: Mapping[str, InterfaceSpec] | None = None,
) -> FEModel:
    """Read a body and prove that the rows of its matrices are the dofs that the files name.

    Parameters
    ----------
    name : str
        Name of the body.
    stiffness, mass : MatrixSource
        Files of its matrices.
    geometry : Path, optional
        Deck, external superelement or mesh; needed for interfaces with positions and for the proof.
    rows : Path or str, optional
        Dofs of the rows: a file that lists node.component, or the name of a dof set of the geometry. By default the
        labels in the matrix file, else the set of the deck or the dofs of the mesh that have the size of the matrix.
    damping : Damping, optional
        Damping law.
    damping_matrix : MatrixSource, optional
        Viscous damping matrix, instead of a law.
    units : Units
        Unit system of the files; nothing is converted here.
    grounded : bool
        True if the body is meant to be held to the ground; the nodes away from the ground are still proven.
    rows_trusted : bool
        True to go on with rows whose order is not proven. All other checks stay.
    interfaces : mapping of str to InterfaceSpec
        Nodes and dofs at which joints attach.

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
    set_name, dof_list = set_or_list(rows, shape)
    named = {"stiffness": stiffness, "mass": mass, "damping": damping_matrix}
    matrices = {
        kind: in_terms_of(shape, read_matrix(Path(source.path), source.matrix, source.format, dof_list))
        for kind, source in named.items()
        if source is not None
    }
    for one in matrices.values():
        # Before the rows are looked for in the geometry, which would be blamed.
        require_square(name, one)
    if shape is not None and matrices["stiffness"].format == "calculix":
        shape = _between_expanded_nodes(shape)
    shape = with_all_modes(name, shape, matrices["stiffness"], matrices["mass"])
    declared = _Declared(name, damping or Damping(), units, grounded, rows_trusted)
    files = _Files(declared, matrices, shape, _sources(matrices, shape, dof_list))
    dofs = _first_in_order(files, possible_rows(name, matrices["stiffness"], matrices["mass"], shape, set_name))
    try:
        body = _body(files, dofs, interfaces or {})
        _check_rigid_elements_act(body, files)
    except SceneError:
        # What is wrong with the files comes first: the draft of a body that cannot be read has a mount of no body.
        body = _body(files, dofs, {})
        _check_rigid_elements_act(body, files)
        prove_row_order(body)
        raise
    try:
        return prove_row_order(body).estimated(body)
    except DofMapError as error:
        by_deck = shape is not None and shape.path.suffix.lower() == ".inp"
        beyond = _LAST_NUMBERS if files.calculix and not by_deck and (dofs.component == SCALAR).any() else ""
        raise DofMapError(f"{error}{beyond}") from error


@dataclass(frozen=True)
class _Declared:
    """Keys of a body beside its files; see `read_body`."""

    name: str
    damping: Damping
    units: Units
    grounded: bool
    rows_trusted: bool


@dataclass(frozen=True, eq=False)
class _Files:
    """A body as its files have it, before its rows are known."""

    declared: _Declared
    matrices: Mapping[str, LabelledMatrix]
    shape: Geometry | None
    sources: tuple[Source, ...]

    @property
    def calculix(self) -> bool:
        """True if the matrices are CalculiX's, which expands shells and beams to solids."""
        return self.matrices["stiffness"].format == "calculix"

    @cached_property
    def rounding(self) -> float:
        """Relative rounding of the entries.

        The type of a file may have more digits than its numbers. Those of K tell: masses are often typed.
        """
        shown = rounding_of_values(self.matrices["stiffness"].A.data)
        return max(shown, *(one.rounding for one in self.matrices.values()))


def _between_expanded_nodes(shape: Geometry) -> Geometry:
    """Geometry with the nodes of CalculiX's shells and beams in the middle of those that they become."""
    if not shape.means:
        return shape
    xyz = shape.nodes.xyz.copy()
    xyz[shape.nodes.index(list(shape.means))] = list(shape.means.values())
    return replace(shape, nodes=replace(shape.nodes, xyz=xyz))


def _first_in_order(files: _Files, candidates: list[DofTable]) -> DofTable:
    """The first of several dof tables in which the rows are in order; the likeliest if there is none."""
    if len(candidates) > 1:
        for table in candidates:
            # A wrong set may lack the interfaces, so the sets are tried without them.
            with contextlib.suppress(DofMapError):
                if prove_row_order(_body(files, table, {})).status != "trusted":
                    return table
    return candidates[0]


def _body(files: _Files, dofs: DofTable, interfaces: Mapping[str, InterfaceSpec]) -> FEModel:
    """The body whose stiffness has its rows at these dofs; nothing is proven yet."""
    declared, shape = files.declared, files.shape
    name = declared.name
    table, common = on_common_rows(name, dofs, [*files.matrices.values()], shape)
    if shape is not None and shape.idle is not None:
        table, common = with_idle_turns(table, common, shape.idle)
    table, common, supports = without_support_rows(table, common, None if shape is None else shape.sets.get("q"))
    K, M, *D = (one.A for one in common)
    sets = {} if shape is None else _sets_with_rows(shape, table)
    remarks = _remarks(files, supports)
    nodes = shape.nodes if shape is not None and len(shape.nodes) else None
    inner = table.component == SCALAR
    inner[sets.get("q", np.empty(0, np.int64))] = True
    if nodes is not None:
        placed, nodes = with_places(K, table, nodes)
        remarks += _moving_scalars(name, table, placed)
        table = placed
    if not declared.grounded:
        K, largest, share = without_round_off(K, M, inner)
        if largest:
            remarks.append(
                f"{name}: the boundary of the superelement resists nothing: its entries in the stiffness, up to "
                f"{largest:.2g} ({share:.1e} of its rows' stiffness by mass and lowest mode), are rounding of "
                "condensation and were set to zero"
            )
    also = (shape.node_sets, shape.expanded) if shape is not None else ()
    resolved = {face: resolve_interface(name, face, one, table, nodes, sets, *also) for face, one in interfaces.items()}
    held = _held(shape, table, supports)
    if shape is not None and nodes is not None and held is not None:
        nodes = with_turned_supports(nodes, held, shape.turned)
    return FEModel(
        name,
        K,
        M,
        table,
        nodes=nodes,
        interfaces=resolved,
        damping=declared.damping,
        D=D[0] if D else None,
        units=declared.units,
        rounding=files.rounding,
        sets=sets,
        constrained=held,
        grounded=declared.grounded,
        rows_trusted=declared.rows_trusted,
        sources=files.sources,
        remarks=tuple(remarks),
    )


def _sets_with_rows(shape: Geometry, table: DofTable) -> dict[str, NDArray[np.int64]]:
    """Rows of the sets of a geometry, of those of which all dofs have rows."""
    found = {label: table.rows(one.node, one.component) for label, one in shape.sets.items()}
    return {label: rows for label, rows in found.items() if rows.size and (rows >= 0).all()}


def _remarks(files: _Files, supports: DofTable) -> list[str]:
    """Remarks on the lengths of a geometry, on expanded elements, and on rows that were left out as supports."""
    name, shape = files.declared.name, files.shape
    found = [] if shape is None else [*other_length(name, shape, files.declared.units)]
    if files.calculix and shape is not None:
        found += [f"{name}: {remark}" for remark in shape.remarks]
    if len(supports):
        found.append(
            f"{name}: {len(supports)} rows have nothing but one number on the diagonal, as those of supports, and "
            f"were left out: {', '.join(supports.labels[:_NAMED])}{' ...' if len(supports) > _NAMED else ''}"
        )
    return found


def _moving_scalars(name: str, table: DofTable, placed: DofTable) -> list[str]:
    """Remark on scalar points that were found to move with the body, as a list of one; else none."""
    moving = np.flatnonzero(placed.component != table.component)
    if not moving.size:
        return []
    shown = ", ".join(placed.labels[row] for row in moving[:_NAMED])
    more = f" and {moving.size - _NAMED} more" if moving.size > _NAMED else ""
    return [f"{name}: scalar points on springs move with the body, as dofs {shown}{more}"]


def _held(shape: Geometry | None, table: DofTable, supports: DofTable) -> DofTable | None:
    """Dofs without rows that are held at zero: those of the geometry, and those whose rows were left out."""
    held = None if shape is None else constrained_dofs(shape, table)
    if not len(supports):
        return held
    return supports if held is None else held.joined(supports[held.rows(supports.node, supports.component) < 0])


def _check_rigid_elements_act(body: FEModel, files: _Files) -> None:
    """Refuse matrices from before the rigid elements and MPCs of the deck: its dependent dofs have stiffness there."""
    geometry, stiffness = files.shape, files.matrices["stiffness"]
    if geometry is None or (followers := geometry.sets.get("m")) is None:
        return
    rows = body.dofs.rows(followers.node, followers.component)
    free = rows[rows >= 0]
    free = free[body.K.diagonal()[free] != 0]
    if free.size:
        raise DofMapError(
            f"body '{body.name}': stiffness '{stiffness.name}' of {stiffness.path} has rows of {free.size} dofs that "
            f"rigid elements or MPCs of {geometry.path} make dependent, the first is {body.dofs.labels[int(free[0])]}: "
            "these do not act in it yet. Give the matrices of the set n, f or a of the same run (KNN, KFF, KAA). If "
            "the matrices hold them as stiff springs, take them out of the deck"
        )


def _sources(
    matrices: Mapping[str, LabelledMatrix], geometry: Geometry | None, dof_list: Path | None
) -> tuple[Source, ...]:
    """Every file read, with its hash."""
    contents = [(matrix.path, f"{kind} {matrix.name}") for kind, matrix in matrices.items()]
    contents += [(path, "geometry") for path in (geometry.files if geometry is not None else ())]
    if dof_list is not None:
        contents.append((dof_list, "row order"))
    hashes = {path: sha256_of(path) for path, _ in contents}
    return tuple(Source(str(path), hashes[path], content) for path, content in contents)
