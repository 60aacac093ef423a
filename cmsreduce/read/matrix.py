"""Matrices of any format: found by content, by name."""

from __future__ import annotations

import difflib
import hashlib
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.dof_list import dof_list_beside, read_dof_list
from cmsreduce.read.labelled_matrix import LabelledMatrix, MatrixInfo, StoredMatrix
from cmsreduce.read.matrix_format import FORMATS, detect_format, require_file

__all__ = ["FORMATS", "matrix_names", "read_matrix", "sha256_of"]

_NAMELESS = ("calculix", "abaqus", "matrix-market", "npy")


def read_matrix(
    path: Path,
    matrix: str | None = None,
    format: str | None = None,
    dofs: Path | None = None,
    *,
    rectangular: bool = False,
) -> LabelledMatrix:
    """Read one matrix of a file.

    Parameters
    ----------
    path : Path
        The file.
    matrix : str, optional
        Name of the matrix; capitals do not matter unless two names differ in them only. Not needed where the file
        holds one matrix.
    format : str, optional
        A key of ``FORMATS``, in place of what the content says.
    dofs : Path, optional
        Dof list, one ``node.component`` a row. A text of entries takes the ``.dof`` file of its own stem unless
        another is given. A matrix that carries labels is put in the order of the list.
    rectangular : bool
        Take a DMIG that is marked rectangular, whose columns are no dofs of the rows.

    Returns
    -------
    LabelledMatrix
        Both triangles of a symmetric matrix. It may be of any shape, and entries that are not finite are left in:
        the body refuses them, naming the dof.

    Raises
    ------
    ReadError
        If the file is missing, empty, truncated, damaged or of an unknown format; if the matrix is not in it, is
        complex, or is not named where there are several; if the dof list does not fit.
    """
    path = Path(path)
    chosen = _format_of(path, format)
    found = _choose(path, _stored(path, chosen), matrix, chosen)
    if found.is_complex:
        raise ReadError(f"{path}: matrix '{found.name}' is complex; stiffness, mass and damping must be real")
    if chosen == "dmig" and found.form == "rectangular" and not rectangular:
        raise ReadError(
            f"{path}: DMIG matrix '{found.name}' is rectangular; stiffness and mass are square (form 1) or symmetric "
            "(form 6): name the matrix of the body, such as KAAX"
        )
    loaded = found.load()
    beside = dof_list_beside(path) if chosen in ("calculix", "abaqus") and loaded.dofs is None else None
    list_path = dofs or beside
    if list_path is None:
        return loaded
    table = read_dof_list(list_path)
    return loaded.with_dofs(table, list_path) if loaded.dofs is None else loaded.on(table)


def matrix_names(path: Path, format: str | None = None) -> list[MatrixInfo]:
    """What matrices a file holds.

    Parameters
    ----------
    path : Path
        The file.
    format : str, optional
        A key of ``FORMATS``, in place of what the content says.

    Returns
    -------
    list of MatrixInfo
        In the order of the file; what has a name but is no matrix of numbers is left out.

    Raises
    ------
    ReadError
        As read_matrix, as far as the headers tell.
    """
    path = Path(path)
    return [stored.info for stored in _stored(path, _format_of(path, format)) if stored.usable]


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, in hexadecimal.

    Raises
    ------
    ReadError
        If the file cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error


def _format_of(path: Path, format: str | None) -> str:
    """The format asked for, or the one found."""
    if format is None:
        return detect_format(path)
    if format not in FORMATS:
        near = difflib.get_close_matches(format, FORMATS, n=1)
        hint = f"did you mean '{near[0]}'? " if near else ""
        raise ReadError(f"{path}: there is no matrix format '{format}'; {hint}known are {', '.join(FORMATS)}")
    require_file(path)
    return format


def _stored(path: Path, format: str) -> list[StoredMatrix]:
    """Matrices of a file of known format; readers are imported as they are needed."""
    if format == "op4":
        from cmsreduce.read.op4 import stored_matrices as op4_matrices

        return op4_matrices(path)
    if format == "op2":
        from cmsreduce.read.op2 import stored_matrices as op2_matrices

        return op2_matrices(path)
    if format == "dmig":
        from cmsreduce.read.dmig import stored_matrices as dmig_matrices

        return dmig_matrices(path)
    if format == "matrix-market":
        from cmsreduce.read.matrix_market import stored_matrices as market_matrices

        return market_matrices(path)
    if format == "mat":
        from cmsreduce.read.matlab import stored_matrices as matlab_matrices

        return matlab_matrices(path)
    if format in ("npz", "npy"):
        from cmsreduce.read.numpy_files import npy_matrices, npz_matrices

        return npz_matrices(path) if format == "npz" else npy_matrices(path)
    from cmsreduce.read.coordinate_text import stored_matrices as coordinate_matrices

    return coordinate_matrices(path, format)


def _choose(path: Path, stored: list[StoredMatrix], wanted: str | None, format: str) -> StoredMatrix:
    """The matrix of a name, or the only one."""
    usable = [one for one in stored if one.usable]
    names = [one.name for one in usable]
    listed = ", ".join(names)
    if wanted is None:
        if len(usable) == 1:
            return usable[0]
        if not usable:
            raise ReadError(f"{path}: there is no matrix in it ({FORMATS[format]})")
        raise ReadError(f"{path}: holds {len(usable)} matrices, name one with `matrix:`: {listed}")
    exact = [one for one in stored if one.name == wanted]
    found = exact or [one for one in stored if one.name.lower() == wanted.lower()]
    if len(found) == 1:
        return found[0]
    if len(found) > 1:
        raise ReadError(
            f"{path}: holds {len(found)} matrices named '{wanted}'; write the one of this body to a file of its own"
        )
    if format in _NAMELESS:
        raise ReadError(
            f"{path}: holds one matrix without a name, so there is no '{wanted}' in it; leave `matrix:` out"
        )
    lower = {name.lower(): name for name in names}
    near = difflib.get_close_matches(wanted.lower(), lower, n=1)
    hint = f" (did you mean {lower[near[0]]}?)" if near else ""
    raise ReadError(f"{path}: there is no matrix '{wanted}' in it{hint}; it holds {listed or 'no matrix'}")
