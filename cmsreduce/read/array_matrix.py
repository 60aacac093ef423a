"""Arrays of numpy and scipy as labelled matrices."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.read.labelled_matrix import DOUBLE, LabelledMatrix, canonical, check_size

__all__ = ["from_array", "kind_of"]

_NAMES = {"f2": "real half", "f4": "real single", "f8": "real double", "c8": "complex single", "c16": "complex double"}


def kind_of(dtype: np.dtype[Any]) -> str | None:
    """Kind of number in words, such as ``real double``; None for what is no number.

    Examples
    --------
    >>> kind_of(np.dtype("f4")), kind_of(np.dtype("c16")), kind_of(np.dtype("i8")), kind_of(np.dtype(object))
    ('real single', 'complex double', 'int64', None)
    """
    if dtype.kind not in "fiuc":
        return None
    short = f"{dtype.kind}{dtype.itemsize}"
    return _NAMES.get(short, "complex" if dtype.kind == "c" else str(dtype))


def from_array(path: Path, name: str, format: str, array: Any) -> LabelledMatrix:
    """Labelled matrix of an array that a file held.

    Parameters
    ----------
    path : Path
        File, for messages.
    name, format : str
        As in LabelledMatrix.
    array : (rows, cols) ndarray or sparse matrix
        Real numbers.

    Raises
    ------
    ReadError
        If entries are no real numbers, there are not two dimensions, or indices are out of range.
    """
    dtype = np.dtype(array.dtype)
    kind = kind_of(dtype)
    if kind is None:
        raise ReadError(f"{path}: '{name}' holds {dtype}, not numbers; save a plain or sparse matrix of real numbers")
    if kind.startswith("complex"):
        raise ReadError(f"{path}: matrix '{name}' is complex; stiffness, mass and damping must be real")
    if array.ndim != 2:
        raise ReadError(f"{path}: '{name}' has {array.ndim} dimensions, a matrix has 2")
    rows, cols = array.shape
    check_size(path, name, rows, cols, path.stat().st_size)
    A = _entries_of(path, name, array) if sp.issparse(array) else _nonzeros_of(array)
    rounding = max(DOUBLE, float(np.finfo(dtype).eps) / 2) if dtype.kind == "f" else DOUBLE
    return LabelledMatrix(A, name, path, format, rounding)


def _nonzeros_of(array: Any) -> sp.csc_array:
    """Sparse array of a dense one."""
    row, col = np.nonzero(array)
    return canonical(row, col, array[row, col], array.shape)


def _entries_of(path: Path, name: str, array: Any) -> sp.csc_array:
    """Canonical form of a sparse matrix, which scipy builds without looking at every index."""
    if array.format in ("csc", "csr", "bsr"):
        try:
            array.check_format(full_check=True)
        except ValueError as error:
            raise ReadError(f"{path}: sparse matrix '{name}' is damaged: {error}; save it again") from error
    entries = array.tocoo()
    return canonical(entries.row, entries.col, entries.data, array.shape)
