"""Kind of a file, by its content: one look, which all readers, commands and refusals share.

The tables of the formats that are read are here; files that are known and not read are in `marks`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import ReadError
from cmsreduce.read.ansys import FULL_FILE, NODE_FILE, NODE_LISTING, is_row_mapping
from cmsreduce.read.calculix_abaqus import ABAQUS, CALCULIX, FRD, INPUT_FILE, SUBSTRUCTURE
from cmsreduce.read.files import LIBRARY_ERRORS, read_head, require_file
from cmsreduce.read.formats import GeometryFormat, MatrixFormat
from cmsreduce.read.marks import MARKS, NO_MODEL, REDUCED, SAVE
from cmsreduce.read.matrices import (
    FREEFEM,
    HARWELL_BOEING,
    MATLAB,
    MATRIX_MARKET,
    NPY,
    NPZ,
    PETSC,
    is_hdf5,
)
from cmsreduce.read.mesh import UNIVERSAL
from cmsreduce.read.nastran import BULK_DATA, DMIG, EXTERNAL_SUPERELEMENT, OP2, OP2_GEOMETRY, OP4

__all__ = [
    "FORMATS",
    "GEOMETRY_FORMATS",
    "GEOMETRY_HEAD",
    "HEAD",
    "FileKind",
    "expect_kind",
    "file_kind",
    "geometry_format",
    "matrix_format",
]

# In the order of detection: DMIG is last, because its cards may stand anywhere in a large deck.
_TEXTS = (MATRIX_MARKET, FREEFEM, HARWELL_BOEING, SUBSTRUCTURE, CALCULIX, ABAQUS, DMIG)
FORMATS: dict[str, MatrixFormat] = {
    format.name: format for format in (OP4, OP2, MATLAB, NPZ, NPY, PETSC, FULL_FILE, *_TEXTS)
}
"""Every format that matrices are read from, by name."""

GEOMETRY_FORMATS: dict[str, GeometryFormat] = {
    format.name: format
    for format in (OP2_GEOMETRY, FRD, NODE_FILE, UNIVERSAL, INPUT_FILE, EXTERNAL_SUPERELEMENT, BULK_DATA, NODE_LISTING)
}
"""Every registered format of geometry files by name, in the order of detection."""

HEAD = 1 << 16
"""Bytes that tell a format of matrices."""

GEOMETRY_HEAD = 1 << 20
"""Bytes that tell a format of geometry: the first node of a deck may come after long case control."""

_START = 4096  # bytes that tell a file that is not read

_INSPECT = "`cmsreduce inspect {path}` shows what is in it"
_NAMED_IN_HDF5 = 4
# Meshes of numbers alone, which meshio finds by the name.
_MESHES_OF_NUMBERS = frozenset({".avs", ".ele", ".node", ".ugrid"})


@dataclass(frozen=True)
class FileKind:
    """Kind of a file.

    Parameters
    ----------
    name : str
        Short name: a key of ``FORMATS`` or ``GEOMETRY_FORMATS``, ``mesh``, ``component``, ``system``, ``sweep``,
        ``pipeline``, ``rows``, ``empty``, ``unknown``, or that of a mark.
    words : str
        The kind in words, for messages: "this is WORDS".
    matrices : str
        Key of ``FORMATS`` if matrices can be read from the file; empty otherwise.
    geometry : str
        Key of ``GEOMETRY_FORMATS``, or ``mesh``, if nodes can be read from the file; empty otherwise.
    step : str
        What to do with a file that is not read, or the command that takes it; empty if there is nothing to say.
    """

    name: str
    words: str
    matrices: str = ""
    geometry: str = ""
    step: str = ""


_PROGRAMS = {
    (".odb", ".sim", ".fil", ".cae"): "Abaqus writes matrices as text with *MATRIX GENERATE and *MATRIX OUTPUT",
    (".db", ".mechdb", ".mechdat", ".wbpj"): "ANSYS writes matrices with HBMAT (Mapping = YES), or *SMAT and *EXPORT",
    (".h3d", ".xdb", ".master", ".dball", ".fem"): "PARAM,EXTOUT,DMIGPCH of NASTRAN and OptiStruct writes matrices",
    (".mnf", ".fbi", ".rfi"): "Start from the matrices and the deck of the finite-element program",
}
"""Remedies for a file of no known content, by the end of its name, as programs write them."""

_OWN = {
    "component": ("a component file of cmsreduce, a body that is reduced already", f"{REDUCED}; {_INSPECT}"),
    "system": ("the assembled reduced system that cmsreduce wrote", _INSPECT),
    "sweep": (
        "the table of a sweep of cmsreduce",
        "pandas and h5py read it; sweep.csv beside it has the same rows",
    ),
    "stage": ("a finished stage of a run of cmsreduce", "`cmsreduce cache ls RUN_DIR` lists the stages of a run"),
    "treetops": ("a body that cmsreduce wrote for TREETOPS, reduced already", "name its component file instead"),
}
"""Words and next step for HDF5 files of this program, by their attribute ``format``."""

_WANTED = {
    "component": (("component",), "a component file, which a run writes as NAME.h5"),
    "pipeline": (("pipeline", "yaml"), "a pipeline file"),
    "result": (("component", "summary"), "a component file, a run directory or its summary.json"),
}
"""Kinds of files that pass, and words, for each kind that a command takes."""


def file_kind(path: Path) -> FileKind:
    """Look at a file and say what it is; its name does not matter.

    Parameters
    ----------
    path : Path
        An existing file.

    Returns
    -------
    FileKind
        ``empty`` for a file without content, ``unknown`` for one that no format and no mark takes.

    Raises
    ------
    ReadError
        If the file is missing, a folder, or cannot be opened.
    """
    if not path.is_file():
        require_file(path)
    head = read_head(path, GEOMETRY_HEAD)
    if not head:
        return FileKind("empty", "an empty file", step="the run that should have written it may have failed")
    if is_row_mapping(path):
        return FileKind("rows", "a list of the rows of a matrix, as ANSYS exports it", step="use it as `rows:`")
    matrices, geometry = matrix_format(path, head), geometry_format(head)
    if matrices is not None or geometry is not None:
        main = matrices or geometry
        assert main is not None
        return FileKind(main.name, main.words, matrices.name if matrices else "", geometry.name if geometry else "")
    if is_hdf5(head):
        return _hdf5_kind(path)
    for mark in MARKS:
        if mark.detect(head[:_START]) and not (mark.name == "table" and path.suffix.lower() in _MESHES_OF_NUMBERS):
            return FileKind(mark.name, mark.words, "", mark.geometry, mark.step.format(path=path))
    start = head.lstrip()[:24].decode("ascii", "backslashreplace")
    words = f"of no known format; it starts with {' '.join(start.split())!r}"
    lists = "if it lists the rows of one, write node.component, one a line"
    for ends, step in _PROGRAMS.items():
        if path.suffix.lower() in ends:
            return FileKind("unknown", words, step=step)
    return FileKind("unknown", words, step=f"If it holds matrices: {SAVE.format()}; {lists}")


def matrix_format(path: Path, head: bytes) -> MatrixFormat | None:
    """Format of matrices that takes a file, from its first bytes."""
    start = head[:HEAD]
    return next((format for format in FORMATS.values() if format.detect(path, start)), None)


def geometry_format(head: bytes) -> GeometryFormat | None:
    """Registered format of geometry that takes a file, from its first bytes."""
    text = head[:GEOMETRY_HEAD].decode("latin-1")
    return next((format for format in GEOMETRY_FORMATS.values() if format.detect(text)), None)


def expect_kind(path: Path, wanted: str) -> None:
    """Refuse a file that is clearly of another kind than a command takes.

    A missing, empty or unknown file passes: the reader of the wanted kind has the better words for it.

    Parameters
    ----------
    path : Path
        The file, or a folder.
    wanted : {"component", "pipeline", "result"}
        Kind of file that the command takes.

    Raises
    ------
    ReadError
        With the kind of the file and the next step.
    """
    kinds, words = _WANTED[wanted]
    if path.is_dir() and wanted != "result":
        found = sorted(path.glob(_FILES_OF[wanted]))[:_NAMED_IN_HDF5]
        rest = f"name the file in it: {', '.join(map(str, found))}" if found else "it has no such file"
        raise ReadError(f"{path}: this is a folder, not {words}; {rest}")
    if path.is_file() and (kind := file_kind(path)).name not in (*kinds, "empty", "unknown"):
        step = kind.step or _INSPECT.format(path=path)
        if wanted == "pipeline" and (kind.matrices or kind.geometry):
            step = f"{step}, and `cmsreduce new NAME FILE...` makes a pipeline from the matrices and the deck of a body"
        elif step == NO_MODEL:
            step = f"name {_NEEDED[wanted]}"
        raise ReadError(f"{path}: this is {kind.words}, not {words}: {step}")


_NEEDED = {
    "pipeline": "the YAML file of the run",
    "component": "NAME.h5 in the folder of the run",
    "result": "the folder of the run",
}
_FILES_OF = {"pipeline": "*.y*ml", "component": "*.h5"}


def _hdf5_kind(path: Path) -> FileKind:
    """Kind of an HDF5 file that MATLAB did not write."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            said, version, items = file.attrs.get("format", ""), file.attrs.get("format_version", ""), list(file)
    except LIBRARY_ERRORS as error:
        reason = " ".join(str(error).split())
        return FileKind("hdf5", f"a damaged HDF5 file ({reason})", step="write it again, or copy it in binary mode")
    return _own(path, said, version) or _foreign(items)


def _own(path: Path, said: Any, version: Any) -> FileKind | None:
    program, _, kind = str(said).replace(" ", "-").partition("-")
    if program != "cmsreduce" or kind not in _OWN:
        return None
    words, step = _OWN[kind]
    stated = f" (format version {version})" if version else ""
    return FileKind(kind, f"{words}{stated}", step=step.format(path=path))


def _foreign(items: Sequence[str]) -> FileKind:
    """Kind of an HDF5 file of another program, from the names of its groups and datasets."""
    if "ENS_MAA" in items:
        return FileKind("mesh", "a MED file (code_aster, Salome)", geometry="mesh")
    if "NASTRAN" in items:
        step = "write the matrices with OUTPUT4 or as DMIG, and name the deck"
        return FileKind("nastran-hdf5", "a result file of NASTRAN in HDF5", step=step)
    named = ", ".join(items[:_NAMED_IN_HDF5]) + (" ..." if len(items) > _NAMED_IN_HDF5 else "")
    return FileKind("hdf5", f"an HDF5 file of another program, with {named or 'nothing'} in it", step=SAVE.format())
