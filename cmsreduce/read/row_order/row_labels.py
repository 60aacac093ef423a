"""What the rows of a body's matrices are: a dof list, labels in the matrix file, a set of the deck, or the mesh."""

from __future__ import annotations

import numpy as np

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import DofTable
from cmsreduce.read.geometry import Geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix

__all__ = ["on_common_rows", "possible_rows"]


def possible_rows(
    body: str, stiffness: LabelledMatrix, mass: LabelledMatrix, geometry: Geometry | None, rows: str | None
) -> list[DofTable]:
    """Dof tables that the rows of the stiffness may be, the likeliest first.

    Parameters
    ----------
    body : str
        Name, for messages.
    stiffness, mass : LabelledMatrix
        The matrices.
    geometry : Geometry, optional
        Geometry of the body.
    rows : str, optional
        Set of the geometry that the user names.

    Raises
    ------
    DofMapError
        If nothing says what the rows are, or no set has their number.
    """
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
            f"body '{body}': nothing says what the {n} rows of '{stiffness.name}' in {stiffness.path} are; give "
            "`geometry:` (the deck or mesh it was made from) or `rows:` (a list of node.component, one a line)"
        )
    found = [table for table in geometry.rows.values() if len(table) == n]
    if not found:
        raise DofMapError(
            f"body '{body}': stiffness '{stiffness.name}' of {stiffness.path} has {n} rows, which is the size of no "
            f"dof set of {geometry.path}. {_sizes(geometry)}. Give the deck that made the matrix, or `rows:`, a list "
            "of node.component, one a line (PARAM,AUTOSPC removes dofs that a deck alone does not tell)"
        )
    return _distinct(found)


def _sizes(geometry: Geometry) -> str:
    """Sizes of all sets of a geometry, and what it could not read."""
    sizes = ", ".join(f"{name} {len(table)}" for name, table in {**geometry.rows, **geometry.sets}.items())
    return f"Its sets have: {sizes}" + "".join(f"; {remark}" for remark in geometry.remarks)


def _distinct(tables: list[DofTable]) -> list[DofTable]:
    """Tables without those that say the same as one before them."""
    out: list[DofTable] = []
    for table in tables:
        if not any(
            np.array_equal(table.node, kept.node) and np.array_equal(table.component, kept.component) for kept in out
        ):
            out.append(table)
    return out


def on_common_rows(
    body: str, dofs: DofTable, matrices: list[LabelledMatrix], geometry: Geometry | None
) -> tuple[DofTable, list[LabelledMatrix]]:
    """Put all matrices of a body on the same rows.

    Unlabelled matrices must have the size of ``dofs``. Labelled ones are reordered; dofs that one of them lacks are
    rows of zeros, as punch files leave those out. Dofs beyond ``dofs`` are added if the geometry knows them.

    Parameters
    ----------
    body : str
        Name, for messages.
    dofs : DofTable
        Rows of the first matrix, or more.
    matrices : list of LabelledMatrix
        Stiffness first.
    geometry : Geometry, optional
        Geometry of the body.

    Returns
    -------
    dofs : DofTable
    matrices : list of LabelledMatrix
        All labelled with ``dofs``.

    Raises
    ------
    MatrixError
        If sizes disagree, or a matrix has dofs that neither the stiffness nor the geometry has.
    """
    first = matrices[0]
    labelled = [_labelled(body, one, dofs, first) for one in matrices]
    table = dofs
    for one in labelled:
        beyond = _beyond(one, table)
        if beyond:
            table = _extended(body, table, one, beyond, first, geometry)
    return table, [one.on(table) for one in labelled]


def _labelled(body: str, matrix: LabelledMatrix, dofs: DofTable, first: LabelledMatrix) -> LabelledMatrix:
    """The matrix with its own labels, or those of the body."""
    rows, cols = matrix.A.shape
    if rows != cols:
        raise MatrixError(
            f"body '{body}': matrix '{matrix.name}' of {matrix.path} is {rows} x {cols}; matrices of a body are square"
        )
    if matrix.dofs is not None:
        return matrix
    if rows != len(dofs) and matrix is not first and not (matrix.format == "abaqus" and rows < len(dofs)):
        raise MatrixError(
            f"body '{body}': the matrices are of different size: '{first.name}' of {first.path} is "
            f"{first.A.shape[0]} x {first.A.shape[1]}, '{matrix.name}' of {matrix.path} is {rows} x {cols}; check that "
            "both are of one model and one dof set"
        )
    return matrix.with_dofs(dofs, matrix.path)


def _beyond(matrix: LabelledMatrix, table: DofTable) -> list[str]:
    """Labels of a matrix that a table lacks."""
    if matrix.dofs is None:
        return []
    missing = table.rows(matrix.dofs.node, matrix.dofs.component) < 0
    return [label for label, gone in zip(matrix.dofs.labels, missing, strict=True) if gone]


def _extended(
    body: str,
    table: DofTable,
    matrix: LabelledMatrix,
    beyond: list[str],
    first: LabelledMatrix,
    geometry: Geometry | None,
) -> DofTable:
    """Rows of a table and of a matrix together, in the order of a set of the geometry that has them all."""
    if matrix.dofs is not None and geometry is not None:
        node = np.concatenate([table.node, matrix.dofs.node])
        component = np.concatenate([table.component, matrix.dofs.component])
        for known in geometry.rows.values():
            rows = np.unique(known.rows(node, component))
            if rows[0] >= 0:
                return DofTable(known.node[rows], known.component[rows])
    raise MatrixError(
        f"body '{body}': '{matrix.name}' of {matrix.path} has {len(beyond)} dofs that '{first.name}' of {first.path} "
        f"lacks, the first is {beyond[0]}"
        + ("; " if geometry is None else f", and no dof set of {geometry.path} has them all; ")
        + "check that both are of one model, or give the deck they were made from as `geometry:`"
    )
