"""Bodies from their files: matrices, the dofs of their rows, geometry, interfaces, and proof of the row order."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, MatrixError, SceneError
from cmsreduce.model import SCALAR, SI, Damping, DofTable, FEModel, Source, Units, rounding_of_values
from cmsreduce.read.files import sha256_of
from cmsreduce.read.formats import NODE_ROWS, Geometry
from cmsreduce.read.geometry import in_terms_of, other_length, read_geometry
from cmsreduce.read.held_dofs import constrained_dofs, with_turned_supports, without_support_rows
from cmsreduce.read.idle_turns import with_idle_turns
from cmsreduce.read.interfaces import InterfaceSpec, MatrixSource, resolve_interface
from cmsreduce.read.labelled_matrix import LabelledMatrix, require_square
from cmsreduce.read.matrix import read_matrix
from cmsreduce.read.nastran import SET_NAMES
from cmsreduce.read.row_order import prove_row_order, without_round_off
from cmsreduce.read.scalar_points import with_all_modes, with_places

__all__ = ["read_body"]

_NAMED = 5
_LAST_NUMBERS = (
    ". Rows with numbers beyond those of the geometry were taken as dofs inside elements; a rigid body (*RIGID BODY, "
    "*COUPLING) has such rows too, and then the geometry must be the .inp file"
)

# Rows that a program leaves out of its matrices without a card in the deck, by the format of the matrices.
_LOST_ROWS = {
    **dict.fromkeys(
        ("op4", "op2", "dmig"),
        " (PARAM,AUTOSPC holds dofs that no card names; add SPC1 cards of those in the "
        "singularity table of the .f06 to the set in force)",
    ),
    "calculix": " (CalculiX lists the rows in the .dof file of the same run: keep it beside the matrices)",
}


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
    set_name, dof_list = _set_or_list(rows, shape)
    matrices = {
        kind: in_terms_of(shape, read_matrix(Path(source.path), source.matrix, source.format, dof_list))
        for kind, source in {"stiffness": stiffness, "mass": mass, "damping": damping_matrix}.items()
        if source is not None
    }
    calculix = matrices["stiffness"].format == "calculix"
    if calculix and shape is not None and shape.means:
        xyz = shape.nodes.xyz.copy()
        xyz[shape.nodes.index(list(shape.means))] = list(shape.means.values())
        shape = replace(shape, nodes=replace(shape.nodes, xyz=xyz))
    for one in matrices.values():
        # Before the rows are looked for in the geometry, which would be blamed.
        require_square(name, one)
    shape = with_all_modes(name, shape, matrices["stiffness"], matrices["mass"])
    sources = _sources(matrices, shape, dof_list)
    # The type of a file may have more digits than its numbers. Those of K tell: masses are often typed.
    shown = rounding_of_values(matrices["stiffness"].A.data)
    rounding = max(shown, *(one.rounding for one in matrices.values()))

    def build(dofs: DofTable, named: Mapping[str, InterfaceSpec]) -> FEModel:
        table, common = _on_common_rows(name, dofs, [*matrices.values()], shape)
        if shape is not None and shape.idle is not None:
            table, common = with_idle_turns(table, common, shape.idle)
        table, common, supports = without_support_rows(table, common, None if shape is None else shape.sets.get("q"))
        K, M, *D = common
        nodes = shape.nodes if shape is not None and len(shape.nodes) else None
        given = {} if shape is None else shape.sets
        found = {label: table.rows(one.node, one.component) for label, one in given.items()}
        # A set counts if all its dofs have rows.
        sets = {label: rows for label, rows in found.items() if rows.size and (rows >= 0).all()}
        inner = table.component == SCALAR
        inner[sets.get("q", np.empty(0, np.int64))] = True
        also = (shape.node_sets, shape.expanded) if shape is not None else ()
        remarks = [] if shape is None else [*other_length(name, shape, units)]
        if calculix and shape is not None:
            remarks += [f"{name}: {remark}" for remark in shape.remarks]
        if len(supports):
            remarks.append(
                f"{name}: {len(supports)} rows have nothing but one number on the diagonal, as those of supports, and "
                f"were left out: {', '.join(supports.labels[:_NAMED])}{' ...' if len(supports) > _NAMED else ''}"
            )
        if nodes is not None:
            placed, nodes = with_places(K.A, table, nodes)
            moving = np.flatnonzero(placed.component != table.component)
            if moving.size:
                shown = ", ".join(placed.labels[row] for row in moving[:_NAMED])
                more = f" and {moving.size - _NAMED} more" if moving.size > _NAMED else ""
                remarks.append(f"{name}: scalar points on springs move with the body, as dofs {shown}{more}")
            table = placed
        stiff, largest, share = (K.A, 0.0, 0.0) if grounded else without_round_off(K.A, M.A, inner)
        if largest:
            remarks.append(
                f"{name}: the boundary of the superelement resists nothing: its entries in the stiffness, up to "
                f"{largest:.2g} ({share:.1e} of its rows' stiffness by mass and lowest mode), are rounding of "
                "condensation and were set to zero"
            )
        resolved = {face: resolve_interface(name, face, one, table, nodes, sets, *also) for face, one in named.items()}
        held = None if shape is None else constrained_dofs(shape, table)
        if len(supports):
            held = supports if held is None else held.joined(supports[held.rows(supports.node, supports.component) < 0])
        if shape is not None and nodes is not None and held is not None:
            nodes = with_turned_supports(nodes, held, shape.turned)
        return FEModel(
            name,
            stiff,
            M.A,
            table,
            nodes=nodes,
            interfaces=resolved,
            damping=damping or Damping(),
            D=D[0].A if D else None,
            units=units,
            rounding=rounding,
            sets=sets,
            constrained=held,
            grounded=grounded,
            rows_trusted=rows_trusted,
            sources=sources,
            remarks=tuple(remarks),
        )

    candidates = _possible_rows(name, matrices["stiffness"], matrices["mass"], shape, set_name)
    dofs = candidates[0]
    if len(candidates) > 1:
        for table in candidates:
            # A wrong set may lack the interfaces, so the sets are tried without them.
            with contextlib.suppress(DofMapError):
                if prove_row_order(build(table, {})).status != "trusted":
                    dofs = table
                    break

    def built(named: Mapping[str, InterfaceSpec]) -> FEModel:
        found = build(dofs, named)
        if shape is not None and (followers := shape.sets.get("m")) is not None:
            _check_rigid_elements_act(found, followers, matrices["stiffness"], shape)
        return found

    try:
        body = built(interfaces or {})
    except SceneError:
        # What is wrong with the files comes first: the draft of a body that cannot be read has a mount of no body.
        prove_row_order(built({}))
        raise
    try:
        return prove_row_order(body).estimated(body)
    except DofMapError as error:
        by_deck = shape is not None and shape.path.suffix.lower() == ".inp"
        beyond = _LAST_NUMBERS if calculix and not by_deck and (dofs.component == SCALAR).any() else ""
        raise DofMapError(f"{error}{beyond}") from error


def _set_or_list(rows: Path | str | None, geometry: Geometry | None) -> tuple[str | None, Path | None]:
    """Name of a dof set, or file of a dof list."""
    if rows is None or isinstance(rows, Path):
        return None, rows
    named = rows in {*SET_NAMES, *NODE_ROWS, *(geometry.rows if geometry is not None else ())}
    # A word that is no file is a misspelt set; the geometry then lists the sets that exist.
    word = geometry is not None and rows.isidentifier() and not Path(rows).exists()
    return (rows, None) if named or word else (None, Path(rows))


def _check_rigid_elements_act(
    body: FEModel, followers: DofTable, stiffness: LabelledMatrix, geometry: Geometry
) -> None:
    """Refuse matrices from before the rigid elements and MPCs of the deck: its dependent dofs have stiffness there."""
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


def _possible_rows(
    body: str, stiffness: LabelledMatrix, mass: LabelledMatrix, geometry: Geometry | None, rows: str | None
) -> list[DofTable]:
    """Dof tables that the rows of the stiffness may be, the likeliest first; ``rows`` is a set that the user names."""
    n = stiffness.A.shape[0]
    if rows is not None:
        if geometry is None:
            raise DofMapError(f"body '{body}': `rows: {rows}` names a dof set, which needs `geometry:`")
        table = geometry.table(rows)
        if stiffness.dofs is None and len(table) != n:
            raise DofMapError(
                f"body '{body}': stiffness '{stiffness.name}' of {stiffness.path} has {n} rows, but set '{rows}' of "
                f"{geometry.path} has {len(table)}. {_sizes(geometry)}"
            )
        return [table]
    if stiffness.dofs is not None:
        return [stiffness.dofs]
    if mass.dofs is not None and len(mass.dofs) == n:
        return [mass.dofs]
    if geometry is None:
        raise DofMapError(
            f"body '{body}': the dofs of the {n} rows of '{stiffness.name}' in {stiffness.path} are unknown; give "
            "`geometry:` (the deck or mesh it was made from) or `rows:` (a list of node.component, one a line)"
        )
    found = [table for table in geometry.rows.values() if len(table) == n]
    if not found:
        raise DofMapError(
            f"body '{body}': stiffness '{stiffness.name}' of {stiffness.path} has {n} rows, which is the size of no "
            f"dof set of {geometry.path}. {_sizes(geometry)}. {_wanted(geometry, stiffness)}"
        )
    # Sets may be equal, such as a and f.
    keys = [(table.node.tobytes(), table.component.tobytes()) for table in found]
    return [table for k, table in enumerate(found) if keys[k] not in keys[:k]]


def _sizes(geometry: Geometry) -> str:
    """Sizes of all sets of a geometry, and its remarks."""
    sizes = ", ".join(f"{name} {len(table)}" for name, table in {**geometry.rows, **geometry.sets}.items())
    return f"Its sets have: {sizes}" + "".join(f"; {remark}" for remark in geometry.remarks)


def _wanted(geometry: Geometry, stiffness: LabelledMatrix) -> str:
    """Remedy for a geometry none of whose sets has as many rows as the matrix."""
    lost, n = _LOST_ROWS.get(stiffness.format, ""), stiffness.A.shape[0]
    # A mesh defines no sets of its own.
    if geometry.rows.keys() <= NODE_ROWS.keys() and n > min(map(len, geometry.rows.values()), default=n):
        lost += "; with elements of second order the mesh must have the nodes between corners, too"
    return f"Give the deck that made the matrix, or `rows:`, a list of node.component, one a line{lost}"


def _on_common_rows(
    body: str, dofs: DofTable, matrices: list[LabelledMatrix], geometry: Geometry | None
) -> tuple[DofTable, list[LabelledMatrix]]:
    """Put all matrices of a body, the stiffness first, on the same rows.

    Unlabelled matrices must have the size of ``dofs``. Labelled ones are reordered; dofs that one of them lacks become
    rows of zeros, because punch files leave out such rows. Dofs beyond ``dofs`` are added if the geometry has them.
    """
    first = matrices[0]
    labelled = [_labelled(body, one, dofs, first) for one in matrices]
    for one in labelled:
        dofs = _extended(body, dofs, one, first, geometry)
    return dofs, [one.on(dofs) for one in labelled]


def _labelled(body: str, matrix: LabelledMatrix, dofs: DofTable, first: LabelledMatrix) -> LabelledMatrix:
    """The matrix with its own labels, or else with the dofs of the body."""
    rows, cols = matrix.A.shape
    if matrix.dofs is not None:
        return matrix
    if rows != len(dofs) and matrix is not first and not (matrix.format == "abaqus" and rows < len(dofs)):
        raise MatrixError(
            f"body '{body}': the matrices are of different size: '{first.name}' of {first.path} is "
            f"{first.A.shape[0]} x {first.A.shape[1]}, '{matrix.name}' of {matrix.path} is {rows} x {cols}; check that "
            "both are of one model and one dof set"
        )
    return matrix.with_dofs(dofs, matrix.path)


def _extended(
    body: str, table: DofTable, matrix: LabelledMatrix, first: LabelledMatrix, geometry: Geometry | None
) -> DofTable:
    """Rows of a table and of a matrix together, in the order of a set of the geometry that has them all."""
    if matrix.dofs is None or (missing := table.rows(matrix.dofs.node, matrix.dofs.component) < 0).sum() == 0:
        return table
    if geometry is not None:
        node = np.concatenate([table.node, matrix.dofs.node])
        component = np.concatenate([table.component, matrix.dofs.component])
        for known in geometry.rows.values():
            rows = np.unique(known.rows(node, component))
            if rows[0] >= 0:
                return known[rows]
    raise MatrixError(
        f"body '{body}': '{matrix.name}' of {matrix.path} has {missing.sum()} dofs that '{first.name}' of {first.path} "
        f"lacks, the first is {matrix.dofs.labels[int(missing.argmax())]}"
        + ("; " if geometry is None else f", and no dof set of {geometry.path} has them all; ")
        + "check that both are of one model, or give the deck they were made from as `geometry:`"
    )
