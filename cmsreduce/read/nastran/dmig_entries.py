"""Sparse matrices of DMIG entries, whichever file holds them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, DofTable
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, mirrored

__all__ = ["DMIG_FORMS", "assembled_dmig", "of_points"]

Ints = NDArray[np.int64]

DMIG_FORMS = {1: "square", 2: "rectangular", 6: "symmetric", 9: "rectangular"}
"""Forms of matrices by their codes."""


def assembled_dmig(
    path: Path, name: str, form: int, row_keys: Ints, col_keys: Ints, values: NDArray[np.float64], rounding: float
) -> LabelledMatrix:
    """Sparse matrix of DMIG entries.

    Parameters
    ----------
    path : Path
        Their file.
    name : str
        Name of the matrix.
    form : int
        1 square, 6 symmetric, 2 and 9 rectangular.
    row_keys, col_keys : (k,) int64
        Dof keys of the row and of the column of each entry.
    values : (k,) float64
        Their numbers.
    rounding : float
        Relative rounding of the numbers.

    Raises
    ------
    ReadError
        If one place has two values.
    """
    row_keys, col_keys = of_points(row_keys, col_keys)
    rows, cols = np.unique(row_keys), np.unique(col_keys)
    if form in (1, 6):
        # A square matrix has the same dofs as rows and as columns.
        rows = cols = np.union1d(rows, cols)
    row, col = np.searchsorted(rows, row_keys), np.searchsorted(cols, col_keys)
    if form == 6:
        row, col = np.maximum(row, col), np.minimum(row, col)
    A = canonical(row, col, values, (rows.size, cols.size))
    # Repeated entries were added, zeros dropped.
    if A.nnz < values.size:
        A = _each_once(path, name, form, (rows, cols), (row, col), values)
    return LabelledMatrix(
        mirrored(A) if form == 6 else A,
        name,
        path,
        "dmig",
        rounding,
        DofTable.from_keys(rows),
        # Columns of form 9 are mere numbers.
        DofTable.from_keys(cols) if form == 2 else None,
    )


def _each_once(
    path: Path, name: str, form: int, keys: tuple[Ints, Ints], places: tuple[Ints, Ints], values: NDArray[np.float64]
) -> sp.csc_array:
    """Matrix of entries of which some repeat others; a ReadError if one place has two values."""
    (rows, cols), (row, col) = keys, places
    _, at, inverse = np.unique(row * max(cols.size, 1) + col, return_index=True, return_inverse=True)
    first = values[at][inverse]
    differs = np.flatnonzero((values != first) & ~(np.isnan(values) & np.isnan(first)))
    if differs.size:
        k = int(differs[0])
        i, j = (DofTable.from_keys(keys).labels[0] for keys in (rows[[row[k]]], cols[[col[k]]]))
        across = " (or across the diagonal)" if form == 6 and i != j else ""
        raise ReadError(
            f"{path}: matrix '{name}' has two values at row {i}, column {j}{across}: {first[k]:.10g} and "
            f"{values[k]:.10g}; a DMIG names each place once, and a symmetric one only one triangle"
        )
    return canonical(row[at], col[at], values[at], (rows.size, cols.size))


def of_points(row_keys: Ints, col_keys: Ints) -> tuple[Ints, Ints]:
    """Keys with component 0 for scalar points: a point that has component 0 in one place has no other component.

    NX gives scalar points component 0 as columns and 1 as rows.
    """
    every = np.concatenate([row_keys, col_keys])
    points = np.unique(every[every % KEY_STEP == 0])
    found = (np.where(np.isin(keys - 1, points), keys - 1, keys) for keys in (row_keys, col_keys))
    return next(found), next(found)
