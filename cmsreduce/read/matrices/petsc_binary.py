"""Sparse matrices in the binary files of PETSc (MatView), which have no names and may follow one another.

A matrix is big-endian: the number 1211216, rows, columns and entries as integers; the entries of each row, their
columns and their values. Of a symmetric matrix (SBAIJ) the upper triangle of blocks is there, and nothing says so.
Source: PETSc manual, MatLoad. Of the builds of PETSc, those with integers of four or eight
bytes and real numbers of double precision are read.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.read.files import reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, check_size, mirrored

__all__ = ["PETSC"]

_MATRIX, _DENSE = 1211216, -1
_DOUBLE = 8
_LARGEST_BLOCK = 6  # dofs of a node


class _Place(NamedTuple):
    """A matrix in a file: where its row counts start, and its size in integers of so many bytes."""

    start: int
    integer: str
    rows: int
    cols: int
    entries: int

    @property
    def end(self) -> int:
        width = np.dtype(self.integer).itemsize
        return self.start + width * (self.rows + self.entries) + _DOUBLE * self.entries


def _integer(head: bytes) -> str | None:
    """Type of the integers of a file; None if no matrix of PETSc starts it."""
    return next((kind for kind in (">i4", ">i8") if head.startswith(np.array(_MATRIX, dtype=kind).tobytes())), None)


def _matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of a file: its stem is the name of the only one; of several, ``1``, ``2`` and so on.

    Raises
    ------
    ReadError
        If a matrix is dense, something else follows one, or the file ends inside one.
    """
    places: list[_Place] = []
    size, at = path.stat().st_size, 0
    with path.open("rb") as file:
        while at < size:
            file.seek(at)
            head = file.read(32)
            integer = _integer(head)
            if integer is None:
                raise ReadError(
                    f"{path}: no matrix of PETSc starts at byte {at}; write each matrix to a file of its own (MatView)"
                )
            with reading(path, "the header"):
                _, rows, cols, entries = (int(number) for number in np.frombuffer(head, integer, 4))
            if entries == _DENSE:
                raise ReadError(
                    f"{path}: the matrix at byte {at} is dense; convert it to a sparse one (aij) and write it"
                )
            check_size(path, path.stem, rows, cols, size)
            place = _Place(at + 4 * np.dtype(integer).itemsize, integer, rows, cols, entries)
            if entries < 0 or place.end > size:
                raise ReadError(
                    f"{path}: the matrix at byte {at} needs {place.end} bytes up to its end and the file has {size}; "
                    "it is truncated, or has complex or single-precision numbers: write it with PETSc for real doubles"
                )
            places.append(place)
            at = place.end
    names = [path.stem] if len(places) == 1 else [str(number) for number in range(1, len(places) + 1)]
    return [
        StoredMatrix(
            name, "real double", "", (place.rows, place.cols, place.entries), partial(_load, path, name, place)
        )
        for name, place in zip(names, places, strict=True)
    ]


def _load(path: Path, name: str, place: _Place) -> LabelledMatrix:
    """Read the entries of a matrix."""
    with reading(path, f"matrix '{name}'"), path.open("rb") as file:
        file.seek(place.start)
        counts = np.fromfile(file, place.integer, place.rows).astype(np.int64)
        col = np.fromfile(file, place.integer, place.entries).astype(np.int64)
        values = np.fromfile(file, ">f8", place.entries).astype(np.float64)
    outside = col.size and (col.min() < 0 or col.max() >= place.cols)
    if outside or (counts < 0).any() or counts.sum() != place.entries:
        raise ReadError(f"{path}: matrix '{name}' contradicts itself; the file is damaged, write or copy it again")
    A = canonical(np.repeat(np.arange(place.rows), counts), col, values, (place.rows, place.cols))
    return LabelledMatrix(_whole(A), name, path, PETSC.name)


def _whole(A: sp.csc_array) -> sp.csc_array:
    """Both triangles of a matrix as SBAIJ writes it: no blocks of some size below the diagonal, and enough above it.

    Those of a body join all its nodes, direction by direction. A few entries above the diagonal alone are an error of
    the matrix.
    """
    entries, n = sp.coo_array(A), A.shape[0]
    for size in (size for size in range(1, _LARGEST_BLOCK + 1) if n % size == 0):
        row, col = entries.row // size, entries.col // size
        if np.count_nonzero(row < col) >= max(n - size, 1) and not (row > col).any():
            return mirrored(A, size)
    return A


PETSC = MatrixFormat("petsc", "PETSc binary", lambda path, head: _integer(head) is not None, _matrices)
