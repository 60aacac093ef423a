"""Matrices as text, one entry a line: ``i j value`` (CalculiX, Abaqus) or ``node,dof, node,dof, value`` (Abaqus).

The dof list of such a matrix has one dof a line, in the order of its rows (CalculiX writes it as ``.dof``).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import KEY_STEP, DofTable, each_once
from cmsreduce.read.calculix_abaqus.expansion import expansion_beside
from cmsreduce.read.files import is_text, read_lines, read_text
from cmsreduce.read.formats import COMPONENTS, MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical, check_size, mirrored
from cmsreduce.read.marks import OCTAVE
from cmsreduce.read.matrices import COORDINATE, LABELLED, PLANE_FREEFEM, read_entries
from cmsreduce.read.printed_numbers import number_of, rounding_of_printed

__all__ = ["ABAQUS", "CALCULIX", "LONGEST_ID", "dof_list_beside", "read_dof_list"]

LONGEST_ID = 15
"""Digits of a node id: ids become keys of dofs in 64-bit integers."""

_SKIPPED = "#%$*"  # first characters of comments, and of keywords of Abaqus
_MARKS = tuple(mark.encode() for mark in _SKIPPED)
_PLAIN_LIST = re.compile(r"(?:[0-9]{1,15}\.[0-6]\n)+[0-9]{1,15}\.[0-6]\n?")
_KEYWORD = re.compile(rb"\s*\*\s*MATRIX", re.IGNORECASE)
# A keyword line that ends with a comma goes on with parameters, which begin with a letter.
_CONTINUED = re.compile(
    rb"^[ \t]*\*[ \t]*[A-Za-z][^\n]*,[ \t]*(?:\n[ \t]*[A-Za-z][^\n]*,[ \t]*)*\n[ \t]*[A-Za-z][^\n]*", re.MULTILINE
)
# Keywords of files that hold something else: decks, and substructures, whose lists of dofs read like entries.
# The version of a gmsh file reads like one, too.
_OTHER_KEYWORD = re.compile(
    r"\s*(?:\*\s*(?:USER\s*ELEMENT|MATRIX(?=\s*,)|HEADING|PART|NODE|ELEMENT|KEYWORD)|\$MeshFormat)\b", re.IGNORECASE
)
_FACTOR = re.compile(rb"SCALEFACTOR=([^,\n]*)")
# SDT writes dof 3 of node 12 as 12.03.
_DIGITS = {digits: component for component in range(7) for digits in (f"{component}", f"0{component}")}
_DOF = re.compile(r"N?(\d+)(?:\s*[.,;]\s*|\s+)(\w+)", re.IGNORECASE)
# Abaqus' name of the instance before the number of a node.
_INSTANCE = re.compile(rb"(^|,)[ \t]*([A-Za-z][\w-]*)\.(?=\d)", re.MULTILINE)


def _coordinate_matrices(path: Path, format: str) -> list[StoredMatrix]:
    """The one matrix of a coordinate text.

    Indices count from one. A file that holds entries on one side of the diagonal only is taken as a triangle of a
    symmetric matrix; a file that holds both sides is taken as it is. Without labels the size is the largest index.
    Loading raises ReadError if a line does not parse, an index is out of range, a place appears twice, or the file ends
    inside a number.
    """

    def load() -> LabelledMatrix:
        return _load(path, format)

    def size() -> tuple[int, int, int | None]:
        A = load().A
        return A.shape[0], A.shape[1], A.nnz

    return [StoredMatrix(path.stem, "real, as text", "", size, load)]


def _load(path: Path, format: str) -> LabelledMatrix:
    """Read the matrix of a coordinate text, labelled or not."""
    text, symmetric, factor = _entries_only(path)
    if _INSTANCE.match(text.lstrip()):
        first, *others = sorted({found[2].decode() for found in _INSTANCE.finditer(text)})
        if others:
            raise ReadError(
                f"{path}: instances {first} and {others[0]} share the numbers of their nodes; write a flat input file, "
                "without parts, or the matrices of one instance"
            )
        text = _INSTANCE.sub(rb"\1", text)
    if LABELLED.begins(text):
        return _load_labelled(path, format, text, symmetric, factor)
    where, value, printed = read_entries(path, text, COORDINATE)
    if where.min() < 1:
        i, j = where[where.min(axis=1) == where.min()][0]
        if min(i, j) < 0:
            raise ReadError(
                f"{path}: there is an entry at row {i}, column {j}; Abaqus gives such numbers to what it makes for "
                "itself, as for the multipliers of connectors, couplings and hybrid elements, which are not reduced: "
                "leave these out"
            )
        raise ReadError(
            f"{path}: there is an entry at row {i}, column {j}, but indices count from 1; if the writer counts from 0, "
            "let it write a Matrix Market or .npz file instead"
        )
    if value.size > 1 and value[0] == value.size - 1 and (where[0] >= where[1:].max(axis=0)).all():
        raise ReadError(
            f"{path}: the first line, '{where[0, 0]} {where[0, 1]} {printed[0]}', states rows, columns and entries; a "
            "text 'i j value' states none: delete that line, or begin the file with the header of Matrix Market"
        )
    n = int(where.max())
    check_size(path, path.stem, n, n, len(text))
    A = _matrix(path, where - 1, factor * value, n, lambda i: str(i + 1))
    return LabelledMatrix(mirrored(A), path.stem, path, format, rounding_of_printed(printed))


def _load_labelled(path: Path, format: str, text: bytes, symmetric: bool, factor: float) -> LabelledMatrix:
    """Read entries that name nodes and dofs, times a factor; the rows are sorted by node and dof."""
    where, value, printed = read_entries(path, text, LABELLED)
    node, dof = where[:, ::2], where[:, 1::2]
    bad = (dof < 0) | (dof > 6)
    if bad.any():
        raise ReadError(
            f"{path}: dof {dof[bad][0]} of node {node[bad][0]} is no displacement or rotation (1..6); temperatures, "
            "pressures and multipliers cannot be reduced: leave them out of the output"
        )
    if (node == 0).any():
        raise ReadError(f"{path}: there is a node 0, and nodes count from 1: number them anew, here and in the deck")
    if (node < 1).any():
        raise ReadError(
            f"{path}: node {node[node < 1][0]} is one that Abaqus made for itself, such as for the multiplier of a "
            "connector or a hybrid element, which is not reduced: leave these elements out"
        )
    keys, place = np.unique(node * KEY_STEP + dof, return_inverse=True)
    dofs = DofTable.from_keys(keys)
    place = place.reshape(node.shape)
    if symmetric:
        # One triangle in the order of the program has entries on both sides of the diagonal in that of the labels.
        upper = np.sort(place, axis=1)
        if np.unique(upper @ [len(dofs), 1]).size == len(upper):
            place = upper
    A = _matrix(path, place, factor * value, len(dofs), lambda i: dofs.labels[i])
    if symmetric:
        A = mirrored(A)
    return LabelledMatrix(A, path.stem, path, format, rounding_of_printed(printed), dofs)


def _entries_only(path: Path) -> tuple[bytes, bool, float]:
    """Text without comments and keywords, whether one triangle may represent both, and the factor of all entries.

    Their lines become empty, so that the other lines keep their numbers.
    """
    text = _whole_keywords(read_lines(path))
    symmetric, factor = True, 1.0
    if any(mark in text for mark in _MARKS):
        lines = text.split(b"\n")
        keywords = [line.upper().replace(b" ", b"") for line in lines if _KEYWORD.match(line)]
        if sum(b"MATRIXINPUT" in line for line in keywords) > 1:
            raise ReadError(f"{path}: holds several *MATRIX INPUT blocks; write each matrix to a file of its own")
        symmetric = not any(b"TYPE=UNSYMMETRIC" in line for line in keywords)
        if found := _FACTOR.search(b"\n".join(keywords)):
            factor = number_of(found[1].decode())
        if sum(line.startswith(b"# name:") for line in lines) > 1:
            raise ReadError(f"{path}: this text of Octave holds several variables: {OCTAVE}")
        text = b"\n".join(b"" if line.lstrip().startswith(_MARKS) else line for line in lines)
    return text, symmetric, factor


def _whole_keywords(text: bytes) -> bytes:
    """Text with each keyword on one line, and an empty line for each line that it went on in."""

    def joined(found: re.Match[bytes]) -> bytes:
        lines = found[0].split(b"\n")
        return b"".join(line.strip() for line in lines) + b"\n" * (len(lines) - 1)

    return _CONTINUED.sub(joined, text) if b"*" in text else text


def _matrix(
    path: Path, where: NDArray[np.int64], value: NDArray[np.float64], n: int, label: Callable[[int], str]
) -> sp.csc_array:
    """Square matrix of entries at rows and columns from zero; a place may appear once."""
    row, col = where.T
    A = canonical(row, col, value, (n, n))
    # Repeated entries were added; zeros were dropped.
    if A.nnz < value.size:
        place = np.sort(row * n + col)
        repeated = place[1:][place[1:] == place[:-1]]
        if repeated.size:
            i, j = divmod(int(repeated[0]), n)
            raise ReadError(
                f"{path}: row {label(i)}, column {label(j)} appears {(place == repeated[0]).sum()} times; a matrix "
                "names each place once, so the file holds two matrices or the parts of several runs"
            )
    return A


def read_dof_list(path: Path) -> DofTable:
    """Read a dof list.

    Parameters
    ----------
    path : Path
        Text with one dof a line: ``node.component``, or the two separated by a blank or a comma; components by number,
        as ``3`` and ``03``, or by name, as ``UX`` and ``DRZ``. Empty lines and lines that start with ``#``, ``%``,
        ``$`` or ``*`` are skipped. The ``.dof`` of CalculiX repeats the dofs of shells and beams; the ``.12d`` beside
        it tells the nodes apart.

    Returns
    -------
    DofTable

    Raises
    ------
    ReadError
        If the file is missing or empty, a line names no dof, or a dof appears twice.
    """
    text = read_text(path, f"{path}: the dof list")
    node, component = _plain_dofs(text) or _any_dofs(path, text)
    if not len(node):
        raise ReadError(f"{path}: the dof list is empty; it needs one node.component for each row of the matrix")
    nodes, components = np.array(node, dtype=np.int64), np.array(component, dtype=np.int64)
    if not nodes.all():
        raise ReadError(f"{path}: there is a node 0, and nodes count from 1: number them anew, here and in the mesh")
    repeated = each_once(nodes * KEY_STEP + components).size < nodes.size
    # Without shells and beams CalculiX leaves the expansion of an earlier job where it is.
    expansion = expansion_beside(path) if repeated else None
    if expansion is not None:
        nodes, components = expansion.relabelled(nodes, components)
    try:
        return DofTable(nodes, components.astype(np.int8))
    except (DofMapError, OverflowError) as error:
        hint = (
            f". CalculiX repeats the dofs of shells and beams, and writes the nodes that they became to "
            f"{path.with_suffix('.12d').name}: put that file beside the list"
        )
        raise ReadError(f"{path}: {error}{hint if repeated and expansion is None else ''}") from error


def _plain_dofs(text: str) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Nodes and components of a list whose every line is ``node.component``; None of any other list."""
    if _PLAIN_LIST.fullmatch(text) is None:
        return None
    node, component = np.fromstring(text.replace(".", " "), dtype=np.int64, sep=" ").reshape(-1, 2).T
    return node, component


def _any_dofs(path: Path, text: str) -> tuple[list[int], list[int]]:
    """Nodes and components of a list, line by line."""
    node, component = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line[0] in _SKIPPED:
            continue
        match = _DOF.fullmatch(line)
        found = None if match is None else _DIGITS.get(match[2], COMPONENTS.get(match[2].upper()))
        if match is None or found is None:
            raise ReadError(
                f"{path}, line {number}: '{line[:40]}' is not a dof; write node.component, such as 1001.3 "
                "(1..3 translations, 4..6 rotations, 0 for a scalar point) or 1001 UZ"
            )
        if len(match[1]) > LONGEST_ID:
            raise ReadError(f"{path}, line {number}: the node '{line[:40]}' is too large; ids have up to 15 digits")
        node.append(int(match[1]))
        component.append(found)
    return node, component


def dof_list_beside(path: Path) -> Path | None:
    """The dof list of the same stem in the folder of a matrix file; None if there is none."""
    for suffix in (".dof", ".DOF"):
        beside = path.with_suffix(suffix)
        if beside != path and beside.is_file():
            return beside
    return None


def _first_lines(path: Path, head: bytes) -> list[str]:
    """Lines of the head that are no comments, without the last one if the end of the head cuts it."""
    if not is_text(head) or re.match(PLANE_FREEFEM, head):
        return []
    lines = _whole_keywords(head.replace(b"\r\n", b"\n")).decode("utf-8-sig", errors="replace").splitlines()
    if any(_OTHER_KEYWORD.match(line) for line in lines):
        return []
    found = [line for line in lines if line.strip() and line.lstrip()[0] not in _SKIPPED]
    found[:1] = [_INSTANCE.sub(rb"\1", line.encode()).decode() for line in found[:1]]
    return found[:-1] if len(found) > 1 and path.stat().st_size > len(head) else found


def _is_upper_triangle(path: Path, head: bytes) -> bool:
    entries = _first_lines(path, head)
    if not entries or not COORDINATE.matches(entries[0]):
        return False
    pairs = (line.replace(",", " ").split()[:2] for line in entries if COORDINATE.matches(line))
    return all(int(i) <= int(j) for i, j in pairs)


CALCULIX = MatrixFormat(
    "calculix",
    "text 'i j value' of one triangle",
    _is_upper_triangle,
    partial(_coordinate_matrices, format="calculix"),
    named=False,
    dof_list=True,
)
ABAQUS = MatrixFormat(
    "abaqus",
    "text 'i j value', or 'node,dof, node,dof, value'",
    lambda path, head: any(LABELLED.matches(line) or COORDINATE.matches(line) for line in _first_lines(path, head)[:1]),
    partial(_coordinate_matrices, format="abaqus"),
    named=False,
    dof_list=True,
)
