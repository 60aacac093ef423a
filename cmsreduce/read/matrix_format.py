"""Which format a matrix file has, by what is in it."""

from __future__ import annotations

import difflib
import re
import struct
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.entry_lines import COORDINATE, LABELLED
from cmsreduce.read.matlab_layout import is_level_4
from cmsreduce.read.op4_printed import is_ascii_header

__all__ = ["FORMATS", "detect_format", "require_file"]

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
