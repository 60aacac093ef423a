"""Dof tables that the rows of a body's matrices may be, by what the user names and by their number."""

from __future__ import annotations

from pathlib import Path

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable
from cmsreduce.read.formats import NODE_ROWS, Geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.nastran import SET_NAMES

__all__ = ["possible_rows", "set_or_list"]

# Rows that a program leaves out of its matrices without a card in the deck, by the format of the matrices.
_LOST_ROWS = {
    **dict.fromkeys(
        ("op4", "op2", "dmig"),
        " (PARAM,AUTOSPC holds dofs that no card names; add SPC1 cards of those in the "
        "singularity table of the .f06 to the set in force)",
    ),
    "calculix": " (CalculiX lists the rows in the .dof file of the same run: keep it beside the matrices)",
}


def set_or_list(rows: Path | str | None, geometry: Geometry | None) -> tuple[str | None, Path | None]:
    """Name of a dof set, or file of a dof list."""
    if rows is None or isinstance(rows, Path):
        return None, rows
    named = rows in {*SET_NAMES, *NODE_ROWS, *(geometry.rows if geometry is not None else ())}
    # A word that is no file is a misspelt set; the geometry then lists the sets that exist.
    word = geometry is not None and rows.isidentifier() and not Path(rows).exists()
    return (rows, None) if named or word else (None, Path(rows))


def possible_rows(
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
