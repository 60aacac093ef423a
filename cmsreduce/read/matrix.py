"""Which format a matrix file has, by what is in it.

Matrices of any format: found by content, by name.
"""

from __future__ import annotations

import difflib
import hashlib
import re
import struct
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.calculix_abaqus import dof_list_beside, read_dof_list
from cmsreduce.read.labelled_matrix import LabelledMatrix, MatrixInfo, StoredMatrix
from cmsreduce.read.matrices import COORDINATE, LABELLED, is_level_4
from cmsreduce.read.nastran import is_ascii_header

__all__ = [
    "FORMATS",
    "detect_format",
    "matrix_names",
    "read_matrix",
    "require_file",
    "sha256_of",
]

FORMATS = {
    "op4": "NASTRAN OUTPUT4, printed or binary",
    "op2": "NASTRAN OUTPUT2",
    "dmig": "NASTRAN DMIG entries",
    "calculix": "text 'i j value' of one triangle",
    "abaqus": "text 'i j value', or 'node,dof, node,dof, value'",
    "matrix-market": "Matrix Market",
    "npz": "numpy or scipy.sparse .npz",
    "npy": "numpy .npy",
    "mat": "MATLAB .mat",
}
"""Every format that matrices are read from, and what it is in words."""

_HEAD = 1 << 16  # bytes looked at before a file is searched as a whole
_COMMENTS = "#%$*"
_DMIG = re.compile(rb"(?:^|\n)[ ]{0,7}DMIG(?:\*|[ ,\t])", re.IGNORECASE)
_BULK_DATA = re.compile(rb"(?:^|\n)\s*(?:GRID[ ,*]|BEGIN\s|CEND|ENDDATA|SOL\s)", re.IGNORECASE)
_TEXT_CONTROLS = b"\t\n\r\f\x1a"


def require_file(path: Path) -> None:
    """See that a file is there and holds something.

    Raises
    ------
    ReadError
        If it is missing (with the nearest name in its folder), a folder, unreadable or empty.
    """
    if not path.exists():
        folder = path.parent
        names = [item.name for item in folder.iterdir()] if folder.is_dir() else []
        near = difflib.get_close_matches(path.name, names, n=1)
        hint = f"; there is a {near[0]}" if near else "" if folder.is_dir() else f"; there is no folder {folder}"
        raise ReadError(f"{path}: there is no such file{hint}")
    if not path.is_file():
        raise ReadError(f"{path}: is a folder, not a file; name the matrix file in it")
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error
    if empty:
        raise ReadError(f"{path}: the file is empty; the run that should have written it may have failed")


def detect_format(path: Path) -> str:
    """Find the format of a matrix file from its content; the file's extension plays no part.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    str
        A key of ``FORMATS``. Text 'i j value' is ``calculix`` where its first entries lie in the upper triangle, else
        ``abaqus``; both are read alike.

    Raises
    ------
    ReadError
        If the file is missing, empty, or of no format known.
    """
    require_file(path)
    with path.open("rb") as file:
        head = file.read(_HEAD)
    # Printed OP4 files may hold zero bytes, in the names of matrices.
    printed = "op4" if is_ascii_header(head.split(b"\n", 1)[0].decode("latin-1")) else None
    found = printed or _binary_format(head) or (_text_format(path, head) if _is_text(head) else None)
    if found is not None:
        return found
    known = ", ".join(f"{name} ({words})" for name, words in FORMATS.items())
    if head.startswith(b"\x1f\x8b"):
        hint = "it is compressed with gzip: unpack it first"
    elif _BULK_DATA.search(head):
        hint = "it looks like a NASTRAN deck or listing without DMIG entries, which holds no matrix"
    else:
        hint = f"known are {known}; name one with `format:` if the file is one of them"
    raise ReadError(f"{path}: the format cannot be told, it starts with {head[:24]!r}: {hint}")


def _is_text(head: bytes) -> bool:
    """Whether bytes are plain text."""
    return not any(byte < 32 and byte not in _TEXT_CONTROLS for byte in head)


def _binary_format(head: bytes) -> str | None:
    """Format of a binary file."""
    if head.startswith(b"PK\x03\x04"):
        return "npz"
    if head.startswith(b"\x93NUMPY"):
        return "npy"
    hdf5 = b"\x89HDF\r\n\x1a\n"
    if head.startswith((b"MATLAB 5", b"MATLAB 7.3", hdf5)) or head[512:].startswith(hdf5):
        return "mat"
    for order in "<>":
        if len(head) < 4:
            break
        length = struct.unpack_from(order + "i", head)[0]
        if length not in (4, 8, 24, 48):
            continue
        closing = head[4 + length : 8 + length]
        if not closing or closing == head[: len(closing)]:
            # A file cut inside its first record still says which format it was.
            return "op2" if length in (4, 8) else "op4"
    return "mat" if is_level_4(head) else None


def _text_format(path: Path, head: bytes) -> str | None:
    """Format of a text file."""
    text = head.decode("utf-8-sig", errors="replace")
    if text.startswith("%%MatrixMarket"):
        return "matrix-market"
    lines = text.splitlines()
    entries = [line for line in lines if line.strip() and line.lstrip()[0] not in _COMMENTS]
    # The last line of what was looked at may be cut by its end.
    entries = entries[:-1] if len(entries) > 1 and len(head) == _HEAD else entries
    if entries and LABELLED.matches(entries[0]):
        return "abaqus"
    if entries and COORDINATE.matches(entries[0]):
        pairs = (line.replace(",", " ").split()[:2] for line in entries if COORDINATE.matches(line))
        return "abaqus" if any(int(i) > int(j) for i, j in pairs) else "calculix"
    return "dmig" if _DMIG.search(head) or _DMIG.search(path.read_bytes()) else None


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
        from cmsreduce.read.nastran import op4_matrices

        return op4_matrices(path)
    if format == "op2":
        from cmsreduce.read.nastran import op2_matrices

        return op2_matrices(path)
    if format == "dmig":
        from cmsreduce.read.nastran import dmig_matrices

        return dmig_matrices(path)
    if format == "matrix-market":
        from cmsreduce.read.matrices import market_matrices

        return market_matrices(path)
    if format == "mat":
        from cmsreduce.read.matrices import matlab_matrices

        return matlab_matrices(path)
    if format in ("npz", "npy"):
        from cmsreduce.read.matrices import npy_matrices, npz_matrices

        return npz_matrices(path) if format == "npz" else npy_matrices(path)
    from cmsreduce.read.calculix_abaqus import coordinate_matrices

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
