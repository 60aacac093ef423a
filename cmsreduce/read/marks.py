"""Files that are known by their first bytes and not read as matrices, with what to do with each."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from cmsreduce.read.matrices import PLANE_FREEFEM

__all__ = ["MARKS", "NO_MODEL", "OCTAVE", "REDUCED", "SAVE", "UNREAD_MESHES"]

REDUCED = "name it as `reduced:` of a component"
_UNPACK = "unpack it, and name the file in it"
NO_MODEL = "name the matrices and the deck or mesh of the body"
SAVE = "`scipy.io.savemat('body.mat', {{'K': K, 'M': M}})` saves matrices to a file that is read"
OCTAVE = "`save -v7 body.mat K M` in Octave writes a file that is read"

UNREAD_MESHES = frozenset({"aster", "femap", "freefem-mesh", "gmsh-1", "ls-dyna", "mfem-mesh", "radioss", "vtk-grid"})
"""Names of marks of files that have nodes, which are not read."""


@dataclass(frozen=True)
class _Mark:
    """A kind of file that is told by its first bytes and is not read, as a matrix or at all."""

    name: str
    words: str
    detect: Callable[[bytes], bool]
    step: str = NO_MODEL
    geometry: str = ""


def _starts(*starts: bytes) -> Callable[[bytes], bool]:
    return lambda head: head.startswith(starts)


def _matches(pattern: bytes) -> Callable[[bytes], bool]:
    found = re.compile(pattern, re.IGNORECASE | re.MULTILINE)
    return lambda head: b"\0" not in head and found.search(head) is not None


# What may stand before the first tag; a comment ends at the first end of one.
_XML_START = rb"(?:\xef\xbb\xbf)?\s*+(?:<\?xml[^>]*+>\s*+|<!--(?>(?s:.)*?-->)\s*+)*+"
_XML = _XML_START + rb"<(?:!DOCTYPE Xdmf|VTKFile|Xdmf)"
_VTK = rb"\A" + _XML_START + rb"<VTKFile\s(?:[^>]*\s)?type\s*=\s*[\"']"
_MESH = rb"\A\s*(?:\$MeshFormat|MeshVersionFormatted\b|# vtk |solid |OFF\b|ply\b|" + _XML + rb")"
# MBDyn reads by record groups, and some writers have other words before them.
_MBDYN = rb"MBDyn MODAL DATA FILE|\A(?:(?:\*\*[^\n]*|[^\S\n]*)\n)*\*\*\s*RECORD\s+GROUP\s+1\s*,"
_SID = rb"^[^\S\n]*part[^\S\n]*\n\s*new modal\b"
# With remarks, separated as spreadsheets do, and by name.
_DOF = rb"\d+(?:(?:\.|[ \t]*[,;][ \t]*|[ \t]+)0?[0-6]|[ \t.,;]+(?:(?:D|U|R|T|DR|ROT)?[XYZ]|UR?[123]))"
_DOFS = rb"\A(?:\xef\xbb\xbf)?(?:\s*#[^\n]*\n)*(?:\s*N?" + _DOF + rb"\s*\n){2}"
# Lines of two numbers or more, under names of columns or without.
_NAMES = rb"(?:[\"A-Z_][^\n;,\t]*+[;,\t][^\n]*+\n)?"
_NUMBERS = rb"(?=[ \t]*+[+-]?[.\d])(?=[^\n]*\d[;,\t ]++[+-]?\.?\d)[\d+.,;ED\t\r -]++\n"
# A row of a large matrix is longer than what is looked at.
_WIDE = rb"[+-]?[.\d][\d+.,;ED\t -]{3000}"
_TABLE = rb"\A(?:\xef\xbb\xbf)?(?:" + _NAMES + 2 * _NUMBERS + rb"|[ \t]*+" + _WIDE + rb")"
# As a number with an exponent, or between semicolons, tabs or blanks.
_DECIMAL_COMMA = rb"\A(?:\xef\xbb\xbf)?[^\n]*+\n[ \t]*+[^\n]*?(?:\d,\d{3,}[ED][+-]?\d|\d,\d+[;\t ]+[+-]?\d+,\d)"
_KEYS = rb"\A(?:\xef\xbb\xbf)?(?:[^\S\n]*(?:#[^\n]*|---[^\n]*|%YAML[^\n]*)?\n)*"

# The first file of an archive: of workbooks as spreadsheets write them, and of other documents.
_DOCUMENT = re.compile(
    rb"PK\x03\x04(?s:.{26})(?:\[Content_Types\]\.xml|_rels/|docProps/|mimetypeapplication/vnd\.oasis)"
)

MARKS = (
    _Mark(
        "octave",
        "a file that Octave's `save` wrote in its own format",
        _starts(b"Octave-1-", b"# Created by Octave"),
        OCTAVE,
    ),
    _Mark(
        "pickle",
        "a file of pickled Python objects, which can run code when opened and is never read",
        lambda head: head[:1] == b"\x80" and head[1:2] in (b"\2", b"\3", b"\4", b"\5"),
        SAVE,
    ),
    _Mark(
        "workbook",
        "a document of a spreadsheet or an office program",
        lambda head: _DOCUMENT.match(head) is not None,
        f"`K = pandas.read_excel(FILE, header=None).to_numpy()` reads a sheet of numbers, and {SAVE}",
    ),
    _Mark(
        "petsc-text",
        "a matrix that PETSc printed as text",
        _matches(rb"\A%?\s*Mat Object:"),
        "write it with a binary viewer (PetscViewerBinaryOpen)",
    ),
    _Mark("gzip", "a file compressed with gzip", _starts(b"\x1f\x8b"), "`gunzip -k {path}`, and name that file"),
    _Mark("zip", "a zip archive", _starts(b"PK\x03\x04", b"PK\x05\x06"), _UNPACK),
    _Mark(
        "compressed", "a compressed file", _starts(b"BZh", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf"), _UNPACK
    ),
    _Mark("tar", "a tar archive", lambda head: head[257:262] == b"ustar", _UNPACK),
    _Mark("utf-16", "a text in UTF-16", _starts(b"\xff\xfe", b"\xfe\xff"), "save it as UTF-8"),
    _Mark(
        "git-lfs",
        "a pointer of Git LFS in place of the file",
        _starts(b"version https://git-lfs.github.com/spec/"),
        "fetch the file: `git lfs pull`",
    ),
    _Mark("picture", "a picture", _starts(b"\x89PNG\r\n", b"\xff\xd8\xff", b"GIF8", b"II*\0", b"MM\0*")),
    _Mark("pdf", "a PDF document", _starts(b"%PDF")),
    _Mark("office", "a document of an office program", _starts(b"\xd0\xcf\x11\xe0")),
    _Mark(
        "ls-dyna",
        "an LS-DYNA keyword file",
        _matches(rb"^\*KEYWORD\b"),
        "write the mesh as NASTRAN bulk data, and the matrices as DMIG",
    ),
    _Mark(
        "femap",
        "a neutral file of Femap",
        _matches(rb"\A\s*-1[^\S\n]*\n[^\S\n]*100[^\S\n]*\n"),
        "export the mesh as NASTRAN bulk data",
    ),
    _Mark(
        "radioss",
        "a starter file of Radioss",
        _matches(rb"\A(?:[#$][^\n]*\n)*(?:#RADIOSS|/BEGIN\b)"),
        "write the mesh as NASTRAN bulk data, and the matrices as DMIG",
    ),
    _Mark(
        "aster",
        "an ASCII mesh of code_aster (.mail)",
        _matches(rb"^[^\S\n]*COOR_[23]D\b"),
        "write the mesh as MED (IMPR_RESU, FORMAT='MED')",
    ),
    _Mark("freefem-mesh", "a plane mesh of FreeFEM", _matches(PLANE_FREEFEM), "write it as .vtu (savevtk of iovtk)"),
    _Mark("gmsh-1", "a mesh of gmsh's version 1", _matches(rb"\A\$NOD\s"), "save it in gmsh as version 2.2 or 4.1"),
    _Mark("mfem-mesh", "a mesh of MFEM", _matches(rb"\AMFEM\b.*\bmesh v"), "write it as VTK (PrintVTK)"),
    _Mark("mfem", "a text of MFEM's Print", _matches(rb"\A\[row 0\]"), "write it with PrintMM"),
    _Mark(
        "f06",
        "a listing of NASTRAN (.f06)",
        _matches(rb"\A1[ \t]*\r?\n(?s:.)*?(?:N A S T R A N|NASTRAN|MSC Software|Siemens)"),
        "name the deck and the OP4, OP2 or punch file of the run",
    ),
    _Mark("sid", "an SID file, a body that is reduced already", _matches(_SID), REDUCED),
    _Mark("mbdyn", "a modal body of MBDyn, which is reduced already", _matches(_MBDYN), REDUCED),
    _Mark("html", "a web page", _matches(rb"\A\s*<(?:!doctype\s+)?html")),
    _Mark("dofs", "a dof list, one node.component a line", _matches(_DOFS), "use it as `rows:`"),
    _Mark(
        "vtk-list",
        "a VTK file that lists others",
        _matches(_VTK + rb"(?:Collection|vtk|P(?:Unstruct|Struct|Poly|Image|Rect|Hyper|Table))"),
        "name the .vtu file that it lists",
    ),
    _Mark(
        "vtk-grid",
        "a surface or grid of VTK",
        _matches(_VTK + rb"(?!UnstructuredGrid)"),
        "write the mesh as .vtu (cast_to_unstructured_grid of pyvista)",
    ),
    _Mark("mesh", "a mesh", _matches(_MESH), geometry="mesh"),
    _Mark(
        "pipeline",
        "a pipeline of cmsreduce (YAML)",
        _matches(_KEYS + rb"(?:name|output|include|components|scene|units|reduce|balance|verify|write)\s*:(?:\s|$)"),
        "run it: `cmsreduce run {path}`",
    ),
    _Mark("yaml", "a YAML file that is no pipeline", _matches(_KEYS + rb"[A-Za-z_][\w-]*:(?:\s|$)")),
    _Mark(
        "summary",
        "the summary of a run",
        # A pipeline in JSON, which is YAML, has no version.
        _matches(rb"\A\s*\{\s*\"name\"\s*:\s*\"[^\"]*\",\s*\"version\"\s*:"),
        "check it: `cmsreduce check {path}`",
    ),
    _Mark(
        "pipeline",
        "a pipeline of cmsreduce (JSON)",
        _matches(rb"\A\s*\{(?s:.)*\"(?:components|scene|include|output)\"\s*:"),
        "run it: `cmsreduce run {path}`",
    ),
    _Mark(
        "decimal-commas",
        "a text of numbers with decimal commas",
        _matches(_DECIMAL_COMMA),
        "write them with points",
    ),
    _Mark(
        "table",
        "a table of numbers that names no format",
        _matches(_TABLE),
        f"{SAVE} (`K = numpy.loadtxt(FILE, delimiter=',')` reads a table); nodes are read from GRID cards of NASTRAN "
        "or from a mesh",
    ),
)
"""Kinds of files that are known and not read, in the order of detection."""
