"""All matrices of a body on the same rows, whatever rows each of their files has."""

from __future__ import annotations

import numpy as np

from cmsreduce.errors import MatrixError
from cmsreduce.model import DofTable
from cmsreduce.read.formats import Geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix

__all__ = ["on_common_rows"]


def on_common_rows(
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
