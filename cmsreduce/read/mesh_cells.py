"""Elements of a mesh as cells between nodes, for pictures: corner nodes only, no physics."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.calculix_abaqus import is_abaqus_input, is_frd, keyword_blocks
from cmsreduce.read.library_errors import LIBRARY_ERRORS
from cmsreduce.read.nastran import Card, read_cards

__all__ = ["CELL_CORNERS", "read_cells"]

Cells = dict[str, NDArray[np.int64]]

CELL_CORNERS = {
    "vertex": 1,
    "line": 2,
    "triangle": 3,
    "quad": 4,
    "tetra": 4,
    "pyramid": 5,
    "wedge": 6,
    "hexahedron": 8,
}
"""Corner nodes of each kind of cell, by meshio's names."""

# Field of the first node, and what the corners make.
_NASTRAN = {
    **dict.fromkeys(("CROD", "CTUBE", "CBAR", "CBEAM", "CBEND", "CBUSH"), (2, "line")),
    **dict.fromkeys(("CONROD", "PLOTEL", "RBAR"), (1, "line")),
    **dict.fromkeys(("CTRIA3", "CTRIA6", "CTRIAR"), (2, "triangle")),
    **dict.fromkeys(("CQUAD4", "CQUAD8", "CQUADR", "CSHEAR"), (2, "quad")),
    "CTETRA": (2, "tetra"),
    "CPYRAM": (2, "pyramid"),
    "CPENTA": (2, "wedge"),
    "CHEXA": (2, "hexahedron"),
}
# Nodes of these stand in every other field: node, motion, node, motion.
_SPRINGS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2")
_ABAQUS = (
    ("C3D4", "tetra", 4),
    ("C3D10", "tetra", 10),
    ("C3D5", "pyramid", 5),
    ("C3D6", "wedge", 6),
    ("C3D15", "wedge", 15),
    ("C3D8", "hexahedron", 8),
    ("C3D20", "hexahedron", 20),
    ("S3", "triangle", 3),
    ("STRI3", "triangle", 3),
    ("S6", "triangle", 6),
    ("STRI65", "triangle", 6),
    ("S4", "quad", 4),
    ("S8", "quad", 8),
    ("B31", "line", 2),
    ("B33", "line", 2),
    ("T3D2", "line", 2),
    ("B32", "line", 3),
    ("T3D3", "line", 3),
)
_FRD = {1: "hexahedron", 2: "wedge", 3: "tetra", 4: "hexahedron", 5: "wedge", 6: "tetra", 7: "triangle", 8: "triangle"}
_FRD |= {9: "quad", 10: "quad", 11: "line", 12: "line"}
_HEAD = 1 << 16


def read_cells(path: Path) -> Cells:
    """Read the elements of a deck or a mesh.

    Parameters
    ----------
    path : Path
        NASTRAN deck, CalculiX .frd, Abaqus .inp, or a mesh that meshio knows.

    Returns
    -------
    dict of cell kind to (k, corners) int64
        Node ids; empty where the file holds no element that can be drawn.

    Raises
    ------
    ReadError
        If the file cannot be opened.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD).decode("latin-1")
    except OSError as error:
        raise ReadError(f"{path}: the mesh cannot be read: {error.strerror or error}") from error
    if "\0" not in head:
        if is_frd(head):
            return _gathered(_of_frd(path))
        if is_abaqus_input(head):
            return _gathered(_of_abaqus(path))
        found = read_cards(path, {*_NASTRAN, *_SPRINGS, "RBE2", "GRID"})
        cards = [card for part in found.sections.values() for named in part.values() for card in named]
        if cards:
            return _gathered(cell for card in cards for cell in _of_card(card))
    return _by_meshio(path)


def _of_card(card: Card) -> Iterator[tuple[str, list[int]]]:
    if card.name in _SPRINGS:
        ends = [card.text(2), card.text(4)]
        if all(end.isdigit() and end != "0" for end in ends):
            yield "line", [int(end) for end in ends]
    elif card.name == "RBE2":
        followers = [field for field in card.fields[3:] if field.isdigit()]
        for node in followers:
            yield "line", [card.integer(1), int(node)]
    elif card.name in _NASTRAN:
        first, kind = _NASTRAN[card.name]
        corners = [card.text(first + k) for k in range(CELL_CORNERS[kind])]
        # A bush may end in the air.
        if all(corner.isdigit() for corner in corners):
            yield kind, [int(corner) for corner in corners]


def _of_abaqus(path: Path) -> Iterator[tuple[str, list[int]]]:
    for block in keyword_blocks(path):
        if block.keyword != "ELEMENT":
            continue
        code = block.options.get("TYPE", "").upper()
        # The longest name that the code starts with: C3D10 is no C3D1, and C3D8R is a C3D8.
        known = max((each for each in _ABAQUS if code.startswith(each[0])), key=lambda each: len(each[0]), default=None)
        if known is None:
            continue
        numbers = [int(field) for _, line in block.data for field in line.split(",") if field.strip().isdigit()]
        _, kind, count = known
        for at in range(0, len(numbers) - count, count + 1):
            nodes = numbers[at + 1 : at + 1 + count]
            # The middle node of a curved beam stands between its ends.
            yield kind, [nodes[0], nodes[-1]] if kind == "line" else nodes[: CELL_CORNERS[kind]]


def _of_frd(path: Path) -> Iterator[tuple[str, list[int]]]:
    inside, kind = False, ""
    with path.open(encoding="utf-8", errors="replace") as stream:
        for line in stream:
            if line.startswith("    3C"):
                inside = True
            elif inside and line.startswith(" -1"):
                kind = _FRD.get(int(line.split()[2]), "")
                nodes: list[int] = []
            elif inside and line.startswith(" -2"):
                fresh = not nodes
                nodes += [int(field) for field in line.split()[1:]]
                if kind and fresh:
                    yield kind, nodes[: CELL_CORNERS[kind]]
            elif inside:
                return


def _by_meshio(path: Path) -> Cells:
    """Cells by meshio, whose nodes are numbered from 1 in order of the file."""
    import meshio

    try:
        # meshio prints and leaves the program on a file it cannot read.
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            blocks = meshio.read(path).cells
    except (SystemExit, meshio.ReadError, *LIBRARY_ERRORS):
        return {}
    found: dict[str, list[NDArray[np.int64]]] = {}
    for block in blocks:
        kind = next((name for name in CELL_CORNERS if block.type.startswith(name)), None)
        if kind is not None and kind != "vertex":
            found.setdefault(kind, []).append(np.asarray(block.data, dtype=np.int64)[:, : CELL_CORNERS[kind]] + 1)
    return {kind: np.vstack(parts) for kind, parts in found.items()}


def _gathered(cells: Iterable[tuple[str, list[int]]]) -> Cells:
    found: dict[str, list[list[int]]] = {}
    for kind, nodes in cells:
        if len(nodes) == CELL_CORNERS[kind]:
            found.setdefault(kind, []).append(nodes)
    return {kind: np.array(nodes, dtype=np.int64) for kind, nodes in found.items()}
