"""Nodes and elements of CalculiX result files (.frd) and of Abaqus and CalculiX input files (.inp)."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.calculix_abaqus.constraints import (
    lost_masses,
    nodes_with_own_rows,
    places_of_means,
    rotation_nodes,
    supports,
    turned_supports,
)
from cmsreduce.read.calculix_abaqus.decks import Block, blocks, deck_sets, element_nodes, longest_start
from cmsreduce.read.calculix_abaqus.expansion import PLANE, expansion_beside
from cmsreduce.read.calculix_abaqus.matrices import LONGEST_ID
from cmsreduce.read.calculix_abaqus.sections import expanded_places
from cmsreduce.read.calculix_abaqus.statement import input_file_statement
from cmsreduce.read.formats import CELL_CORNERS, Geometry, GeometryFormat, cells_by_kind
from cmsreduce.read.printed_numbers import coordinate_rounding, whole_number

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
    "M3D3": ("triangle", 3),
    "M3D6": ("triangle", 6),
    "M3D4": ("quad", 4),
    "M3D8": ("quad", 8),
    "B31": ("line", 2),
    "B33": ("line", 2),
    "T3D2": ("line", 2),
    "B32": ("line", 3),
    "T3D3": ("line", 3),
}
# Of the size of a body: nodes that lie nearer are at one place.
_SAME_PLACE = 1e-6
# Masses, springs and dampers by the start of their name, with their nodes: CalculiX leaves a row to each.
_POINT_ELEMENTS = {"MASS": 1, "DCOUP3D": 1, "SPRING1": 1, "SPRING2": 2, "SPRINGA": 2, "DASHPOTA": 2}


def _read_frd(path: Path) -> Geometry:
    """Nodes of an ascii .frd file, in order of the file, along the basic axes.

    Raises
    ------
    ReadError
        If there is no node block, it is binary, or it is damaged.
    """
    ids: list[int] = []
    xyz: list[list[float]] = []
    texts: list[str] = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        numbered = enumerate(stream, start=1)
        header = next((line for _, line in numbered if line.startswith("    2C")), None)
        if header is None:
            raise ReadError(f"{path}: no node block (record 2C) in this .frd file; write it with *NODE FILE")
        code = whole_number(header.split()[-1])
        if code is None or code not in _FRD_ID_WIDTH:
            raise ReadError(f"{path}: the node block is binary (format {code}); write an ascii .frd file")
        start = _FRD_KEY + _FRD_ID_WIDTH[code]
        for number, line in numbered:
            if not line.startswith(" -1"):
                break
            try:
                ids.append(int(line[_FRD_KEY:start]))
                texts += [line[at : at + _FRD_REAL] for at in range(start, start + 3 * _FRD_REAL, _FRD_REAL)]
                xyz.append([float(text) for text in texts[-3:]])
            except ValueError:
                raise ReadError(
                    f"{path}, line {number}: '{line.rstrip()[:60]}' is no node; the file is damaged"
                ) from None
    announced = header.split()[1]
    if whole_number(announced) not in (None, len(ids)):
        raise ReadError(f"{path}: {announced} nodes are announced and {len(ids)} are there; the file is truncated")
    points = np.array(xyz).reshape(-1, 3)
    rounding = coordinate_rounding(texts)
    expansion = expansion_beside(path)
    if expansion is None:
        return Geometry.of_mesh(path, Nodes.in_basic(ids, points, rounding))
    # A knot lies in the middle of the nodes that it moves.
    at = dict(zip(ids, points, strict=True))
    knots = {knot: [at[id] for id in expansion.nodes[knot] if id in at] for knot in expansion.knots if knot not in at}
    knots = {knot: places for knot, places in knots.items() if places}
    points = np.vstack([points, *(np.mean(places, axis=0)[None] for places in knots.values())])
    mesh = Geometry.of_mesh(path, Nodes.in_basic([*ids, *knots], points, rounding))
    return replace(mesh, expanded=expansion.nodes)


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


def _read_input(path: Path) -> Geometry:
    """Nodes of an input file, of its parts, instances and included files.

    They are in order of the file, in basic (the assembly's system), and move along the basic axes.

    Raises
    ------
    ReadError
        If a node repeats with other coordinates (instances that share numbers), nodes are generated, turned or given
        in a local system, there are none, or the deck is one sector of a body.
    """
    parts: dict[str, Coordinates] = {}
    nodes: Coordinates = {}
    target, rounding = nodes, 0.0
    instance: Block | None = None
    deck = list(blocks(path))
    for block in deck:
        if block.keyword in _UNREAD:
            raise ReadError(
                f"{block.where}: {_UNREAD[block.keyword]} are not read; give the geometry as a mesh with plain nodes, "
                "such as a flattened input file or .frd"
            )
        if block.keyword == "CYCLIC SYMMETRY MODEL":
            raise ReadError(
                f"{block.where}: the matrices are those of one sector, whose sides are tied to each other, and no body "
                "that moves by itself; mesh the whole body"
            )
        if block.keyword == "PART":
            target = parts.setdefault(block.option("NAME"), {})
        elif block.keyword == "INSTANCE":
            instance, target = block, dict(parts.get(block.option("PART"), {}))
        elif block.keyword == "END PART":
            target = nodes
        elif block.keyword == "END INSTANCE" and instance is not None:
            _merge(nodes, _placed(target, instance), instance.where)
            instance, target = None, nodes
        elif block.keyword == "NODE":
            more, off = _node_lines(block)
            _merge(target, more, block.where)
            rounding = max(rounding, off)
    if not nodes:
        raise ReadError(f"{path}: there are no nodes in it (no *NODE in the assembly)")
    return _with_rows(path, deck, nodes, rounding)


def _with_rows(path: Path, deck: list[Block], nodes: Coordinates, rounding: float) -> Geometry:
    """Geometry of the nodes of a deck: its sets and supports, and the nodes that CalculiX makes of shells and beams."""
    sets = deck_sets(deck, {name: count for name, (_, count) in _INPUT_CELLS.items()} | _POINT_ELEMENTS)
    turning = rotation_nodes(deck, sets, max(nodes))
    held = supports(deck, sets, turning)
    expansion = expansion_beside(path)
    if expansion is not None and any(block.option("TYPE").startswith(PLANE) for block in deck):
        expansion.refuse_unread()
    if expansion is not None and any(sets.topology.get(each.number) != each.nodes for each in expansion.elements):
        # Without shells and beams CalculiX leaves the expansion of an earlier job where it is.
        expansion = None
    gone = set(turning)
    if expansion is not None:
        made = expanded_places(deck, nodes, sets, expansion)
        expanded = {element.number for element in expansion.elements}
        others = [of for number, of in sets.topology.items() if number not in expanded]
        points, solid = ({node for of in others if (len(of) > 2) == large for node in of} for large in (False, True))
        moved = set(expansion.nodes) - solid - set(expansion.knots)
        kept_ones = nodes_with_own_rows(deck, sets) | points | {node for node, _ in held}
        gone |= moved - kept_ones
        # With an offset, they are not where the deck has them.
        middles = {node: _middle(made, expansion.nodes[node]) for node in moved & kept_ones}
        nodes = nodes | made | middles
    kept = {id: xyz for id, xyz in nodes.items() if id not in gone}
    mesh = Geometry.of_mesh(path, Nodes.in_basic(list(kept), np.array(list(kept.values())), rounding))
    means = {node: at for node, at in places_of_means(deck, sets, nodes).items() if node in kept}
    node, component = np.array(sorted(held), dtype=np.int64).reshape(-1, 2).T
    return replace(
        mesh,
        constrained=DofTable(node, component.astype(np.int8)) if held else None,
        turned=turned_supports(deck, sets, held, kept),
        node_sets={name: np.array(ids, dtype=np.int64) for name, ids in sets.nodes.items() if ids},
        turning=turning,
        means=means,
        remarks=tuple(
            f"CalculiX moves node {node} of a *DISTRIBUTING COUPLING with the mean of its nodes: it is taken as lying "
            f"there, at ({', '.join(f'{x:.6g}' for x in at)})"
            for node, at in means.items()
            if not np.allclose(at, kept[node], rtol=0, atol=_SAME_PLACE * float(np.ptp(mesh.nodes.xyz, axis=0).max()))
        )
        + tuple(
            f"CalculiX leaves the mass at node {node} out of its matrices, and out of its own modes: it is the "
            "reference node of a *DISTRIBUTING coupling, which has no rows. Put it on the surface, or take *KINEMATIC"
            for node in lost_masses(deck, sets)
        ),
        expanded={} if expansion is None else expansion.nodes,
    )


def _middle(places: Coordinates, ids: Sequence[int]) -> tuple[float, ...]:
    return tuple(np.mean([places[id] for id in ids], axis=0).tolist())


def _input_cells(path: Path) -> Iterator[tuple[str, list[int]]]:
    for block in blocks(path):
        if block.keyword != "ELEMENT":
            continue
        if not (known := longest_start(block.option("TYPE"), _INPUT_CELLS)):
            continue
        kind, count = _INPUT_CELLS[known]
        for _, nodes in element_nodes(block, count):
            # The middle node of a curved beam is listed between its ends.
            yield kind, [nodes[0], nodes[-1]] if kind == "line" else list(nodes[: CELL_CORNERS[kind]])


def _node_lines(block: Block) -> tuple[Coordinates, float]:
    """Nodes of one *NODE block, absent coordinates zero, and their rounding."""
    if block.options.get("SYSTEM", "R").upper()[:1] != "R":
        raise ReadError(f"{block.where}: cylindrical and spherical coordinates are not read; write rectangular ones")
    out: Coordinates = {}
    texts: list[str] = []
    for path, number, line in block.data:
        fields = [text.strip() for text in line.split(",")]
        try:
            xyz = tuple(float(text.upper().replace("D", "E") or 0) for text in (*fields[1:4], "", "", ""))[:3]
            texts += fields[1:4]
            if len(fields[0]) > LONGEST_ID:
                raise ValueError
            out[int(fields[0])] = xyz
        except ValueError:
            raise ReadError(f"{path}, line {number}: '{line.strip()[:60]}' is no node: id, x, y, z") from None
    return out, coordinate_rounding(texts)


def _placed(nodes: Coordinates, instance: Block) -> Coordinates:
    """Nodes of an instance moved, then turned, by its data lines."""
    try:
        numbers = [[float(text) for text in line.split(",") if text.strip()] for *_, line in instance.data]
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
    input_file_statement,
)
