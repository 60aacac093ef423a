"""A matrix as a file gives it: sparse entries, what its rows are where the file says so, how finely it is rounded."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable

__all__ = [
    "DOUBLE",
    "SINGLE",
    "LabelledMatrix",
    "MatrixInfo",
    "StoredMatrix",
    "canonical",
    "check_size",
    "mirrored",
]

DOUBLE = 2.0**-53
"""Relative rounding of a double-precision number."""

SINGLE = 2.0**-24
"""Relative rounding of a single-precision number."""

# Files leave empty rows and columns out, so a header may rightly claim more of them than the file has bytes; up to this
# many cost 160 MB of pointers, harmless. Beyond, a claim must be covered by the bytes of the file.
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
        Format of the file, one of ``cmsreduce.read.matrix.FORMATS``.
    rounding : float
        Relative rounding of the entries: 2**-53 double, 2**-24 single, half a unit of the last printed digit for text
        (5e-11 for ten digits).
    dofs : DofTable, optional
        What each row is, where the file or its dof list says so.
    column_dofs : DofTable, optional
        What each column is, for a labelled rectangular matrix; None where columns are as rows, or unlabelled.
    """

    A: sp.csc_array
    name: str
    path: Path
    format: str
    rounding: float = DOUBLE
    dofs: DofTable | None = None
    column_dofs: DofTable | None = None

    def with_dofs(self, dofs: DofTable, named_by: Path) -> LabelledMatrix:
        """Label rows and columns that the format left unlabelled.

        A coordinate text does not say its size, only its largest index: it grows to the size of the list.

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
            # CalculiX prints every diagonal entry, also a zero one: a missing last one is a cut file.
            if self.format == "calculix":
                raise ReadError(
                    f"{self.path}: the entries stop at row {rows}, but the dof list {named_by} has {n} dofs; the "
                    "matrix is truncated, or the list belongs to another run"
                )
            A = sp.csc_array(sp.block_diag([A, sp.csc_array((n - rows, n - rows))], format="csc"))
        if A.shape != (n, n):
            raise ReadError(
                f"{self.path}: matrix '{self.name}' is {A.shape[0]} x {A.shape[1]}, but the dof list {named_by} has "
                f"{n} dofs; check that both are of one run"
            )
        return replace(self, A=A, dofs=dofs)

    def on(self, dofs: DofTable) -> LabelledMatrix:
        """The same matrix in the rows of another dof table: reordered, with empty rows for dofs it lacks.

        A DMIG matrix leaves its empty rows out, so a mass matrix may be smaller than the stiffness it belongs to.

        Parameters
        ----------
        dofs : DofTable
            Rows wanted.

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
                f"{self.path}: matrix '{self.name}' has {len(lacking)} dofs that are not in the dof list asked for, "
                f"the first is {lacking[0]}; check that both are of one model"
            )
        entries = sp.coo_array(self.A)
        A = canonical(to[entries.row], to[entries.col], entries.data, (len(dofs), len(dofs)))
        return replace(self, A=A, dofs=dofs)


@dataclass(frozen=True)
class MatrixInfo:
    """What a file says of one of its matrices, without its entries.

    Parameters
    ----------
    name : str
        Name as the file spells it.
    rows, cols : int
        Size.
    nnz : int, optional
        Stored entries, where they can be known without reading them.
    numbers : str
        Kind of number: ``real double``, ``real single``, ``complex double``, ``real double, 10 digits``.
    form : str
        What the file calls it: ``symmetric``, ``square``, ``rectangular``, or empty.
    """

    name: str
    rows: int
    cols: int
    nnz: int | None
    numbers: str
    form: str = ""


@dataclass(frozen=True)
class StoredMatrix:
    """One matrix of a file that has been looked over but not loaded.

    Parameters
    ----------
    name : str
        Name as the file spells it.
    numbers, form : str
        As in MatrixInfo.
    size : callable
        Gives rows, columns and stored entries; entries are None where they cannot be known without loading.
    load : callable
        Reads it; raises ReadError if the entries are damaged.
    usable : bool
        False for what has a name but is no matrix of numbers; loading it says what it is.
    """

    name: str
    numbers: str
    form: str
    size: Callable[[], tuple[int, int, int | None]]
    load: Callable[[], LabelledMatrix]
    usable: bool = True

    @property
    def is_complex(self) -> bool:
        """Whether its entries are complex, which no stage takes."""
        return self.numbers.startswith("complex")

    @property
    def info(self) -> MatrixInfo:
        """What can be said of it without loading."""
        return MatrixInfo(self.name, *self.size(), self.numbers, self.form)


def canonical(row: ArrayLike, col: ArrayLike, data: ArrayLike, shape: tuple[int, int]) -> sp.csc_array:
    """Sparse array of (row, column, value) entries counted from zero: sorted, repeated entries added, zeros dropped."""
    values: NDArray[np.float64] = np.asarray(data, dtype=np.float64)
    A = sp.csc_array(sp.coo_array((values, (np.asarray(row), np.asarray(col))), shape=shape))
    A.sum_duplicates()
    A.eliminate_zeros()
    return A


def mirrored(A: sp.csc_array) -> sp.csc_array:
    """Both triangles of a symmetric matrix of which only one may be stored; a matrix that holds both is returned as is.

    Parameters
    ----------
    A : (n, n) sparse array
    """
    if A.shape[0] != A.shape[1]:
        return A
    entries = sp.coo_array(A)
    below, above = entries.row > entries.col, entries.row < entries.col
    if below.any() == above.any():
        return A
    off = below | above
    row = np.concatenate([entries.row, entries.col[off]])
    col = np.concatenate([entries.col, entries.row[off]])
    return canonical(row, col, np.concatenate([entries.data, entries.data[off]]), A.shape)


def check_size(path: Path, name: str, rows: int, cols: int, file_bytes: int) -> None:
    """Refuse a size that the bytes of the file cannot back, before anything of that size is allocated.

    Raises
    ------
    ReadError
        If a dimension is negative, or absurd against the size of the file.
    """
    if rows < 0 or cols < 0 or max(rows, cols) > max(_HARMLESS_SIZE, file_bytes):
        raise ReadError(
            f"{path}: matrix '{name}' claims {rows} x {cols} in a file of {file_bytes} bytes; the header is damaged or "
            "the format is not what it seems: write the file again, or name its format with `format:`"
        )
