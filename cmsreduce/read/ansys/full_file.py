"""Stiffness and mass of an ANSYS .full file, with the dof of each row, through the library ansys-mapdl-reader.

The library is an extra: ``pip install cmsreduce[ansys]``. It reads the triangle that ANSYS stores, and the supports.
"""

from __future__ import annotations

import struct
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable
from cmsreduce.read.files import reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, check_size, mirrored
from cmsreduce.read.libraries import Arrays, arrays_of

__all__ = ["FULL_FILE", "RESULT", "binary_kind", "library_refused"]

# The first record has 100 integers; the first of them is the kind of the file: matrices, or results.
_RECORD = struct.pack("<2i", 100, -(2**31))
_FULL, RESULT = 4, 12
_KINDS = {2: ".emat", 8: ".sub"}
# Places of integers in the header, which follows a record of 100 with its two lengths and the check after it.
_HEADER, _LENGTHS = 103, 2
_EQUATIONS, _ACTIVE, _LUMPED, _UNSYMMETRIC, _CONSTRAINT_EQUATIONS = 1, 2, 10, 13, 20
_HEADER_INTEGERS = 40
_EXPORT = (
    "let ANSYS write it as text: *SMAT,K,D,IMPORT,FULL,file.full,STIFF and *EXPORT,K,MMF,K.txt, the same with MASS, "
    "and *VEC,MAP,I,IMPORT,FULL,file.full,BACK for `rows:`; or HBMAT with its mapping file, whose matrices have "
    "constraints and couplings worked in"
)


def binary_kind(head: bytes) -> int | None:
    """Number that ANSYS gives to its kinds of binary files; None for other files."""
    return int.from_bytes(head[8:12], "little") if head.startswith(_RECORD) and len(head) >= 12 else None


def library_refused(path: Path, reason: str) -> ReadError:
    """Error for a file of ANSYS that the library does not read, or a library that is not there."""
    if "No module named" in reason:
        return ReadError(
            f"{path}: files of ANSYS are read by the library ansys-mapdl-reader, which is not installed ({reason}): "
            "pip install 'cmsreduce[ansys]'"
        )
    return ReadError(f"{path}: ansys-mapdl-reader cannot read the file: {reason or 'it ended without a word'}")


def _matrices(path: Path) -> list[StoredMatrix]:
    """Stiffness K and mass M of a .full file.

    Raises
    ------
    ReadError
        If the file is another binary file of ANSYS, or has what the library does not read: a lumped mass, constraint
        equations, matrices that are not symmetric.
    """
    with path.open("rb") as file:
        head = file.read(4 * (_HEADER + _LENGTHS + _HEADER_INTEGERS))
    kind = binary_kind(head)
    if kind != _FULL:
        raise ReadError(
            f"{path}: is a binary file of ANSYS ({_KINDS.get(kind or 0, f'kind {kind}')}), of which no matrices are "
            "read; write them as text by HBMAT with its mapping file (Mapping = YES), which is read as `rows:`"
        )
    with reading(path, "the header"):
        header = struct.unpack_from(f"<{_HEADER_INTEGERS}i", head, 4 * (_HEADER + _LENGTHS))
    rows = header[_ACTIVE]
    check_size(path, "K", rows, header[_EQUATIONS], path.stat().st_size)
    for place, what in ((_LUMPED, "a lumped mass"), (_UNSYMMETRIC, "matrices that are not symmetric")):
        if header[place] not in (0, -1):
            raise ReadError(
                f"{path}: the file has {what}, which the library ansys-mapdl-reader does not read; {_EXPORT}"
            )
    if header[_CONSTRAINT_EQUATIONS] > 0:
        raise ReadError(
            f"{path}: the file has {header[_CONSTRAINT_EQUATIONS]} constraint equations, which are not in its "
            f"matrices; {_EXPORT}"
        )
    return [
        StoredMatrix(name, "real double", "symmetric", (rows, rows, None), partial(_load, path, name))
        for name in ("K", "M")
    ]


def _load(path: Path, name: str) -> LabelledMatrix:
    """Read one matrix; supports have no rows."""
    arrays = arrays_of(path, "ansys-full", lambda reason: library_refused(path, reason))
    if f"{name} data" not in arrays:
        raise ReadError(f"{path}: there is no matrix {name} in it; a modal analysis writes stiffness and mass")
    dofs, kept = _row_dofs(path, arrays)
    place = np.full(kept.size, -1)
    place[kept] = np.arange(len(dofs))
    with reading(path, f"matrix {name}"):
        row, col = (place[arrays[f"{name} {part}"].astype(np.int64)] for part in ("row", "col"))
    if min(row.min(initial=0), col.min(initial=0)) < 0:
        raise ReadError(f"{path}: matrix {name} has entries at supports; the file is damaged, write it again")
    A = canonical(row, col, arrays[f"{name} data"], (len(dofs), len(dofs)))
    return LabelledMatrix(mirrored(A), name, path, FULL_FILE.name, dofs=dofs)


def _row_dofs(path: Path, arrays: Arrays) -> tuple[DofTable, NDArray[np.bool_]]:
    """Dofs of the rows, and which rows of the library are no supports."""
    table, held = (arrays[name].astype(np.int64).reshape(-1, 2) for name in ("row_dofs", "held"))
    # The library counts the dofs of a node from zero.
    kept = ~np.isin(table @ [8, 1], held @ [8, 1])
    try:
        return DofTable(table[kept, 0], (table[kept, 1] + 1).astype(np.int8)), kept
    except DofMapError as error:
        raise ReadError(f"{path}: {error}; only displacements and rotations can be reduced") from error


FULL_FILE = MatrixFormat(
    "ansys-full",
    "ANSYS .full",
    lambda path, head: binary_kind(head) not in (None, RESULT),
    _matrices,
)
