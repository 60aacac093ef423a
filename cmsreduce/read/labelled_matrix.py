"""Matrices as read from files: sparse entries, the dofs of the rows where the file names them, and the rounding."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError, ReadError
from cmsreduce.model import DOUBLE, SINGLE, DofTable

__all__ = [
    "DOUBLE",
    "SINGLE",
    "LabelledMatrix",
    "canonical",
    "check_size",
    "complex_refused",
    "mirrored",
    "require_square",
]

# Files leave out empty rows and columns, so a header may rightly claim more of them than the file has bytes. Up to this
# number they cost 160 MB of pointers, which is harmless; beyond it the bytes of the file must cover the claim.
_HARMLESS_SIZE = 20_000_000


@dataclass(frozen=True, eq=False)
class LabelledMatrix:
    """A matrix read from a file.

    Parameters
    ----------
    A : (rows, cols) sparse array
        Entries, both triangles of a symmetric matrix; zeros are not stored.
    name : str
        Name as the file spells it; the file's stem where the format has no names.
    path : Path
        File it came from.
    format : str
        Name of the format of the file, as in ``MatrixFormat``.
    rounding : float
        Relative rounding of the entries: 2**-53 double, 2**-24 single, half a unit of the last printed digit for text
        (5e-11 for ten digits).
    dofs : DofTable, optional
        Dof of each row, where the file or its dof list names them.
    column_dofs : DofTable, optional
        Dof of each column of a labelled rectangular matrix; None where columns are as rows, or unlabelled.
    """

    A: sp.csc_array
    name: str
    path: Path
    format: str
    rounding: float = DOUBLE
    dofs: DofTable | None = None
    column_dofs: DofTable | None = None

    def with_dofs(self, dofs: DofTable, named_by: Path) -> LabelledMatrix:
        """Label rows and columns that the file left unlabelled.

        A coordinate text does not state its size, so a matrix from it grows to the size of the list.

        Parameters
        ----------
        dofs : DofTable
            One dof a row.
        named_by : Path
            File of the list, for messages.

        Raises
        ------
        ReadError
            If the list is not as long as the matrix.
        """
        n, rows = len(dofs), self.A.shape[0]
        A = self.A
        if self.format in ("calculix", "abaqus") and rows < n:
            # CalculiX prints every diagonal entry, also a zero one; if the last one is missing, the file was cut.
            if self.format == "calculix":
                raise ReadError(
                    f"{self.path}: the entries stop at row {rows}, but the dof list {named_by} has {n} dofs; the "
                    "matrix is truncated, or the list belongs to another run"
                )
            A = sp.csc_array(sp.block_diag([A, sp.csc_array((n - rows, n - rows))], format="csc"))
        if self.format == "calculix" and rows == 2 * n:
            raise ReadError(
                f"{self.path}: it has two rows for each of the {n} dofs of {named_by}, real and imaginary, as CalculiX "
                "writes a sector of a *CYCLIC SYMMETRY MODEL; mesh the whole body"
            )
        if A.shape != (n, n):
            raise ReadError(
                f"{self.path}: matrix '{self.name}' is {A.shape[0]} x {A.shape[1]}, but the dof list {named_by} has "
                f"{n} dofs; check that both are of one run"
            )
        return replace(self, A=A, dofs=dofs)

    def on(self, dofs: DofTable) -> LabelledMatrix:
        """Put the matrix in the rows of another dof table: reordered, with empty rows for dofs that it lacks.

        A DMIG matrix leaves out its empty rows, so a mass matrix may be smaller than the stiffness of the same body.

        Parameters
        ----------
        dofs : DofTable
            Rows of the result.

        Raises
        ------
        ReadError
            If the matrix has no labels, or has dofs that the table lacks.
        """
        if self.dofs is None or self.column_dofs is not None or self.A.shape[0] != self.A.shape[1]:
            raise ReadError(
                f"{self.path}: matrix '{self.name}' is not square with a dof for each row, so it cannot be reordered"
            )
        to = dofs.rows(self.dofs.node, self.dofs.component)
        if (to < 0).any():
            lacking = [label for label, row in zip(self.dofs.labels, to, strict=True) if row < 0]
            raise ReadError(
                f"{self.path}: matrix '{self.name}' has {len(lacking)} dofs that the dof list lacks, "
                f"the first is {lacking[0]}; check that both are of one model"
            )
        if np.array_equal(to, np.arange(len(dofs))):
            return replace(self, dofs=dofs)
        entries = sp.coo_array(self.A)
        A = canonical(to[entries.row], to[entries.col], entries.data, (len(dofs), len(dofs)))
        return replace(self, A=A, dofs=dofs)


def canonical(row: ArrayLike, col: ArrayLike, data: ArrayLike, shape: tuple[int, int]) -> sp.csc_array:
    """Sparse array of entries (row, column, value) counted from zero: sorted, repeated entries added, zeros dropped."""
    values: NDArray[np.float64] = np.asarray(data, dtype=np.float64)
    A = sp.csc_array(sp.coo_array((values, (np.asarray(row), np.asarray(col))), shape=shape))
    A.sum_duplicates()
    A.eliminate_zeros()
    return A


def mirrored(A: sp.csc_array, block: int = 1) -> sp.csc_array:
    """Both triangles of a symmetric matrix (n, n); a matrix that stores both is returned unchanged.

    Parameters
    ----------
    A : (n, n) sparse array
    block : int
        Rows and columns of the blocks of which one triangle is stored, those on the diagonal whole.
    """
    if A.shape[0] != A.shape[1]:
        return A
    entries = sp.coo_array(A)
    row, col = entries.row // block, entries.col // block
    below, above = row > col, row < col
    if below.any() == above.any():
        return A
    off = below | above
    row = np.concatenate([entries.row, entries.col[off]])
    col = np.concatenate([entries.col, entries.row[off]])
    return canonical(row, col, np.concatenate([entries.data, entries.data[off]]), A.shape)


def complex_refused(path: Path, name: str) -> ReadError:
    """Error for a matrix with an imaginary part; programs for responses hold real matrices as complex ones, too."""
    return ReadError(
        f"{path}: matrix '{name}' is complex; stiffness, mass and damping must be real: write its real part alone"
    )


def require_square(body: str, matrix: LabelledMatrix) -> None:
    """Refuse a matrix of a body that is empty or not square.

    Raises
    ------
    MatrixError
        With its size.
    """
    rows, cols = matrix.A.shape
    if rows == cols > 0:
        return
    fault = "matrices of a body are square" if rows != cols else "it is empty, as where a set of the run had no dofs"
    raise MatrixError(
        f"body '{body}': matrix '{matrix.name}' of {matrix.path} is {rows} x {cols}; {fault}: name another matrix, or "
        "write it again"
    )


def check_size(path: Path, name: str, rows: int, cols: int, file_bytes: int) -> None:
    """Refuse a size that is too large for the bytes of the file, before memory of that size is allocated.

    Raises
    ------
    ReadError
        If a dimension is negative, or far too large for the size of the file.
    """
    if rows < 0 or cols < 0 or max(rows, cols) > max(_HARMLESS_SIZE, file_bytes):
        raise ReadError(
            f"{path}: matrix '{name}' claims {rows} x {cols} in a file of {file_bytes} bytes; the header is damaged or "
            "the format is not what it seems: write the file again, or name its format with `format:`"
        )
