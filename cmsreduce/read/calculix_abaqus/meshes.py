"""Nodes and elements of CalculiX result files (.frd) and of Abaqus and CalculiX input files (.inp)."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus.matrices import LONGEST_ID
from cmsreduce.read.files import read_text
from cmsreduce.read.formats import CELL_CORNERS, Geometry, GeometryFormat, cells_by_kind
from cmsreduce.read.printed_numbers import coordinate_rounding

__all__ = ["FRD", "INPUT_FILE"]

Coordinates = dict[int, tuple[float, ...]]
"""x, y, z by node id."""

_FRD_ID_WIDTH = {0: 5, 1: 10}  # by the format code at the end of the header of the node block
_FRD_KEY, _FRD_REAL = 3, 12
_FRD_CELLS = {
    **dict.fromkeys((1, 4), "hexahedron"),
    **dict.fromkeys((2, 5), "wedge"),
    **dict.fromkeys((3, 6), "tetra"),
    **dict.fromkeys((7, 8), "triangle"),
    **dict.fromkeys((9, 10), "quad"),
    **dict.fromkeys((11, 12), "line"),
}

_INPUT_KEYWORD = re.compile(r"^\*(NODE|PART|INSTANCE|HEADING|INCLUDE)\b", re.IGNORECASE | re.MULTILINE)
_LS_DYNA = re.compile(r"^\*KEYWORD\b", re.IGNORECASE | re.MULTILINE)
# Keywords that make, move or turn nodes in ways that are not read; ignoring one would give wrong geometry.
_UNREAD = {
    "NGEN": "generated nodes",
    "NFILL": "generated nodes",
    "NCOPY": "copied nodes",
    "NMAP": "mapped nodes",
    "SYSTEM": "node coordinates in a local system",
    "TRANSFORM": "degrees of freedom in a local system",
}
# Kind of cell and nodes by the start of an element's name.
_INPUT_CELLS = {
    "C3D4": ("tetra", 4),
    "C3D10": ("tetra", 10),
    "C3D5": ("pyramid", 5),
    "C3D6": ("wedge", 6),
    "C3D15": ("wedge", 15),
    "C3D8": ("hexahedron", 8),
    "C3D20": ("hexahedron", 20),
    "S3": ("triangle", 3),
    "STRI3": ("triangle", 3),
    "S6": ("triangle", 6),
    "STRI65": ("triangle", 6),
    "S4": ("quad", 4),
    "S8": ("quad", 8),
    "B31": ("line", 2),
    "B33": ("line", 2),
    "T3D2": ("line", 2),
    "B32": ("line", 3),
    "T3D3": ("line", 3),
}


def _read_frd(path: Path) -> Geometry:
    """Nodes of an ascii .frd file, in order of the file, along the basic axes.

    Raises
    ------
    ReadError
        If there is no node block, it is binary, or it is damaged.
    """
    ids: list[int] = []
    xyz: list[list[float]] = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        numbered = enumerate(stream, start=1)
        header = next((line for _, line in numbered if line.startswith("    2C")), None)
        if header is None:
            raise ReadError(f"{path}: no node block (record 2C) in this .frd file; write it with *NODE FILE")
        code = int(header.split()[-1]) if header.split()[-1].isdigit() else -1
        if code not in _FRD_ID_WIDTH:
            raise ReadError(f"{path}: the node block is binary (format {code}); write an ascii .frd file")
        start = _FRD_KEY + _FRD_ID_WIDTH[code]
        for number, line in numbered:
            if not line.startswith(" -1"):
                break
            try:
                ids.append(int(line[_FRD_KEY:start]))
                xyz.append([float(line[at : at + _FRD_REAL]) for at in range(start, start + 3 * _FRD_REAL, _FRD_REAL)])
            except ValueError:
                raise ReadError(
                    f"{path}, line {number}: '{line.rstrip()[:60]}' is no node; the file is damaged"
                ) from None
    announced = header.split()[1]
    if announced.isdigit() and int(announced) != len(ids):
        raise ReadError(f"{path}: {announced} nodes are announced and {len(ids)} are there; the file is truncated")
    points = np.array(xyz).reshape(-1, 3)
    return Geometry.of_mesh(path, Nodes.in_basic(ids, points, coordinate_rounding(points)))


def _frd_cells(path: Path) -> Iterator[tuple[str, list[int]]]:
    inside, kind, nodes = False, "", list[int]()
    with path.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            if line.startswith("    3C"):
                inside = True
            elif inside and line.startswith(" -1"):
                kind = _FRD_CELLS.get(int(line.split()[2]), "")
                nodes = []
            elif inside and line.startswith(" -2"):
                fresh = not nodes
                nodes += [int(text) for text in line.split()[1:]]
                if kind and fresh:
                    yield kind, nodes[: CELL_CORNERS[kind]]
            elif inside:
                return


@dataclass
class _Block:
    """A keyword with its options and its data lines, each with its number."""

    keyword: str
    options: dict[str, str]
    where: str
    path: Path
    data: list[tuple[int, str]] = field(default_factory=list)


def _read_input(path: Path) -> Geometry:
    """Nodes of an input file, of its parts, instances and included files.

    They are in order of the file, in basic (the assembly's system), and move along the basic axes.

    Raises
    ------
    ReadError
        If a node repeats with other coordinates (instances that share numbers), nodes are generated, turned or given
        in a local system, or there are none.
    """
    parts: dict[str, Coordinates] = {}
    nodes: Coordinates = {}
    target = nodes
    instance: _Block | None = None
    for block in _blocks(path):
        if block.keyword in _UNREAD:
            raise ReadError(
                f"{block.where}: {_UNREAD[block.keyword]} are not read; give the geometry as a mesh with plain nodes, "
                "such as a flattened input file or .frd"
            )
        if block.keyword == "PART":
            target = parts.setdefault(block.options.get("NAME", "").upper(), {})
        elif block.keyword == "INSTANCE":
            instance, target = block, dict(parts.get(block.options.get("PART", "").upper(), {}))
        elif block.keyword == "END PART":
            target = nodes
        elif block.keyword == "END INSTANCE" and instance is not None:
            _merge(nodes, _placed(target, instance), instance.where)
            instance, target = None, nodes
        elif block.keyword == "NODE":
            _merge(target, _node_lines(block), block.where)
    if not nodes:
        raise ReadError(f"{path}: there are no nodes in it (no *NODE in the assembly)")
    points = np.array(list(nodes.values()))
    return Geometry.of_mesh(path, Nodes.in_basic(list(nodes), points, coordinate_rounding(points)))


def _input_cells(path: Path) -> Iterator[tuple[str, list[int]]]:
    for block in _blocks(path):
        if block.keyword != "ELEMENT":
            continue
        code = block.options.get("TYPE", "").upper()
        # The longest name that the code starts with: C3D10 is no C3D1, and C3D8R is a C3D8.
        known = max((name for name in _INPUT_CELLS if code.startswith(name)), key=len, default=None)
        if known is None:
            continue
        numbers = [int(text) for _, line in block.data for text in line.split(",") if text.strip().isdigit()]
        kind, count = _INPUT_CELLS[known]
        for at in range(0, len(numbers) - count, count + 1):
            nodes = numbers[at + 1 : at + 1 + count]
            # The middle node of a curved beam is listed between its ends.
            yield kind, [nodes[0], nodes[-1]] if kind == "line" else nodes[: CELL_CORNERS[kind]]


def _blocks(path: Path, chain: tuple[Path, ...] = ()) -> Iterator[_Block]:
    """Keyword blocks of a file and of the files it includes."""
    if path.resolve() in chain:
        raise ReadError(f"{path} includes itself")
    block: _Block | None = None
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("**"):
            continue
        if not line.startswith("*"):
            if block is not None:
                block.data.append((number, line))
            continue
        if block is not None:
            yield block
        head, *rest = (part.strip() for part in line[1:].split(","))
        options = {key.strip().upper(): value.strip() for key, _, value in (part.partition("=") for part in rest)}
        block = _Block(" ".join(head.upper().split()), options, f"{path}, line {number}: *{head}", path)
        if block.keyword == "INCLUDE":
            yield from _blocks(path.parent / options.get("INPUT", ""), (*chain, path.resolve()))
            block = None
    if block is not None:
        yield block


def _node_lines(block: _Block) -> Coordinates:
    """Nodes of one *NODE block: id, x, y, z, absent coordinates zero."""
    if block.options.get("SYSTEM", "R").upper()[:1] != "R":
        raise ReadError(f"{block.where}: cylindrical and spherical coordinates are not read; write rectangular ones")
    path, data = block.path, block.data
    if "INPUT" in block.options:
        path = block.path.parent / block.options["INPUT"]
        data = list(enumerate(read_text(path, f"{block.where}: {path}").splitlines(), start=1))
    out: Coordinates = {}
    for number, line in data:
        if not line.strip() or line.startswith("**"):
            continue
        fields = [text.strip() for text in line.split(",")]
        try:
            xyz = tuple(float(text.upper().replace("D", "E") or 0) for text in (*fields[1:4], "", "", ""))[:3]
            if len(fields[0]) > LONGEST_ID:
                raise ValueError
            out[int(fields[0])] = xyz
        except ValueError:
            raise ReadError(f"{path}, line {number}: '{line.strip()[:60]}' is no node: id, x, y, z") from None
    return out


def _placed(nodes: Coordinates, instance: _Block) -> Coordinates:
    """Nodes of an instance moved, then turned, by its data lines."""
    try:
        numbers = [[float(text) for text in line.split(",") if text.strip()] for _, line in instance.data]
    except ValueError:
        raise ReadError(f"{instance.where}: its placement is not made of numbers") from None
    if not numbers:
        return nodes
    xyz = np.array(list(nodes.values())).reshape(-1, 3) + (numbers[0] + [0.0, 0.0, 0.0])[:3]
    if len(numbers) > 1:
        if len(numbers[1]) != 7:
            raise ReadError(f"{instance.where}: a rotation needs two points and an angle in degrees, 7 numbers")
        # Rodrigues' rotation about the axis through two points.
        start, end = np.array(numbers[1][:3]), np.array(numbers[1][3:6])
        if not (length := float(np.linalg.norm(end - start))) > 0:
            raise ReadError(f"{instance.where}: the two points of its axis of rotation are at one place")
        axis = (end - start) / length
        angle, arm = np.radians(numbers[1][6]), xyz - start
        along = (arm @ axis)[:, None] * axis
        xyz = start + along + np.cos(angle) * (arm - along) + np.sin(angle) * np.cross(axis, arm)
    return {id: tuple(map(float, row)) for id, row in zip(nodes, xyz, strict=True)}


def _merge(into: Coordinates, more: Coordinates, where: str) -> None:
    """Add nodes; one id may not have two places."""
    for id, xyz in more.items():
        if into.setdefault(id, xyz) != xyz:
            raise ReadError(
                f"{where}: node {id} has two places, {into[id]} and {xyz}; where instances share node numbers, "
                "write the model flat (one numbering), then give its geometry and matrices"
            )


FRD = GeometryFormat(
    "frd",
    "CalculiX .frd",
    # The first record is 1C.
    lambda head: head.lstrip("\r\n").startswith("    1C"),
    _read_frd,
    lambda path: cells_by_kind(_frd_cells(path)),
    "CalculiX writes them as .sti and .mas (*FREQUENCY, SOLVER=MATRIXSTORAGE)",
)
INPUT_FILE = GeometryFormat(
    "inp",
    "Abaqus or CalculiX .inp",
    # LS-DYNA has keywords of the same names, after *KEYWORD.
    lambda head: (found := _INPUT_KEYWORD.search(head)) is not None and not _LS_DYNA.search(head, 0, found.start()),
    _read_input,
    lambda path: cells_by_kind(_input_cells(path)),
    "CalculiX writes them as .sti and .mas (*FREQUENCY, SOLVER=MATRIXSTORAGE), Abaqus as .mtx (*MATRIX GENERATE)",
)
