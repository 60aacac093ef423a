"""Places of the nodes that shells and beams become in CalculiX: thickness and normals from the input file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.calculix_abaqus.decks import Block, DeckSets
from cmsreduce.read.calculix_abaqus.expansion import SHELL_NODES, ExpandedElement, Expansion
from cmsreduce.read.printed_numbers import number_of, real_number

__all__ = ["expanded_places"]

Array = NDArray[np.float64]
Places = dict[int, tuple[float, ...]]

# Places in the reference element and powers of its shape functions, by the number of nodes: of a line, of a triangle
# or a quadrilateral.
_LINES = {
    2: ([(-1,), (1,)], [(0,), (1,)]),
    3: ([(-1,), (0,), (1,)], [(0,), (1,), (2,)]),
}
_TRIANGLE = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5)]
_SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, -1), (1, 0), (0, 1), (-1, 0)]
_POWERS = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2), (2, 1), (1, 2)]
_FACES = {
    3: (_TRIANGLE[:3], _POWERS[:3]),
    4: (_SQUARE[:4], _POWERS[:4]),
    6: (_TRIANGLE, _POWERS[:6]),
    8: (_SQUARE, _POWERS),
}
# Places in a beam's section in half thicknesses along its two axes: corners, then middles of the edges.
_SECTION = np.array([(-1, 1), (-1, -1), (1, -1), (1, 1), (-1, 0), (0, -1), (1, 0), (0, 1)], dtype=np.float64)
# The corners of a round section lie on its circumference.
_ROUND = np.array([np.sqrt(0.5)] * 4 + [1.0] * 4)[:, None]
_SECTIONS = ("RECT", "CIRC", "PIPE", "BOX")
_ADVICE = "is not read; give the .frd file of a run with *NODE FILE as geometry, which has the expanded nodes"


@dataclass(frozen=True)
class _Section:
    """Section of shells (thickness alone) or of beams: thickness and offset along two axes, the first axis.

    An offset places the node in the section: the section lies on the other side of it.
    """

    thickness: tuple[float, ...]
    offset: tuple[float, ...]
    first_axis: tuple[float, ...] = ()
    round: bool = False


def expanded_places(
    deck: Sequence[Block], places: Mapping[int, Sequence[float]], sets: DeckSets, expansion: Expansion
) -> Places:
    """Coordinates of the nodes that the shells and beams of an input file become.

    Parameters
    ----------
    deck : sequence of Block
        The input file.
    places : mapping of int to three floats
        Coordinates of its nodes.
    sets : DeckSets
        Its sets of elements.
    expansion : Expansion
        Nodes that each node becomes in each element.

    Raises
    ------
    ReadError
        If an element has no section, or one that is not read, or is of a kind that `Expansion` refuses.

    Notes
    -----
    The axes at a node are the means of those of its elements: the normals of shells, the tangents and second axes of
    beams. Where these differ too much, CalculiX makes nodes for each normal and ties them to the node by a knot.
    """
    expansion.refuse_unread()
    sections = _sections(deck, sets)
    axes: dict[int, list[Array]] = {}
    of: dict[int, tuple[int, ExpandedElement, tuple[int, ...]]] = {}
    for element in expansion.elements:
        missing = [node for node in element.nodes if node not in places]
        if missing or element.number not in sections:
            lack = f"node {missing[0]} has no place" if missing else "it has no *SHELL SECTION or *BEAM SECTION"
            raise ReadError(
                f"{expansion.path}: element {element.number}: {lack} in {deck[0].path}; both must be of one job"
            )
        xyz = np.array([places[node] for node in element.nodes])
        section = sections[element.number]
        where = f"{expansion.path}: element {element.number}"
        for node, ids, along in zip(element.nodes, element.became, _directions(element, xyz), strict=True):
            axes.setdefault(ids[0], []).append(_axes(section, along, where))
            of.setdefault(ids[0], (node, element, ids))
            if len(ids) > len(of[ids[0]][2]):
                of[ids[0]] = (node, element, ids)
    out: Places = {}
    for first, (node, element, ids) in of.items():
        across = _across(sections[element.number], np.array(ids) - first, element.beam)
        mean = _mean(np.sum(axes[first], axis=0), f"{expansion.path}: node {node}")
        at = np.asarray(places[node]) + across @ mean
        out |= {id: tuple(map(float, row)) for id, row in zip(ids, at, strict=True)}
    return out


def _directions(element: ExpandedElement, xyz: Array) -> Array:
    """Tangents of a beam, or normals of a shell, at its nodes (k, 3)."""
    at, powers = (np.array(part, dtype=np.float64) for part in (_LINES if element.beam else _FACES)[len(xyz)])
    shapes = np.linalg.inv(np.prod(at[:, None, :] ** powers, axis=2))
    along = []
    for axis in range(at.shape[1]):
        lowered = powers.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        along.append((powers[:, axis] * np.prod(at[:, None, :] ** lowered, axis=2)) @ shapes @ xyz)
    return np.asarray(along[0] if element.beam else np.cross(along[0], along[1]))


def _unit(v: Array, where: str) -> Array:
    """Unit vector; a ReadError for one without length."""
    if not 0 < (length := float(np.linalg.norm(v))) < np.inf:
        raise ReadError(
            f"{where}: no axes of its section follow from its nodes and its section: nodes at one place, a first axis "
            "along the beam, or normals against each other; mend the mesh"
        )
    return v / length


def _axes(section: _Section, along: Array, where: str) -> Array:
    """Normal of a shell (1, 3), or tangent and second axis of a beam's section (2, 3), in one element."""
    direction = _unit(along, where)
    if not section.first_axis:
        return direction[None]
    return np.stack([direction, _unit(np.cross(direction, section.first_axis), where)])


def _mean(summed: Array, where: str) -> Array:
    """Axes of the thicknesses at a node, from the sums over its elements: a shell's normal, a beam's two axes."""
    direction = _unit(summed[0], where)
    if len(summed) == 1:
        return np.asarray(direction[None])
    second = _unit(summed[1] - (summed[1] @ direction) * direction, where)
    return np.stack([np.cross(second, direction), second])


def _across(section: _Section, number: NDArray[np.int64], beam: bool) -> Array:
    """Places of the expanded nodes of one node along the axes (k, 2 or 1); ``number`` counts them within the node."""
    t, offset = np.array(section.thickness), np.array(section.offset)
    if not beam:
        return np.asarray(((number - (SHELL_NODES - 1) / 2) / 2 - offset)[:, None] * t)
    places = _SECTION * _ROUND if section.round else _SECTION
    return np.asarray((places[number] / 2 - offset) * t)


def _sections(deck: Sequence[Block], sets: DeckSets) -> dict[int, _Section]:
    """Section of each shell and beam."""
    found: dict[int, _Section] = {}
    for block in deck:
        if block.keyword == "NORMAL":
            raise ReadError(f"{block.where}: a normal that the user gives {_ADVICE}")
        if block.keyword not in ("SHELL SECTION", "BEAM SECTION", "BEAM GENERAL SECTION"):
            continue
        try:
            found_in = ([real_number(text) for text in fields] for fields in block.rows)
            rows = [[number for number in numbers if number is not None] for numbers in found_in]
            section = _shell(block, rows) if block.keyword == "SHELL SECTION" else _beam(block, rows)
        except (ValueError, IndexError):
            raise ReadError(f"{block.where}: its thickness or its offset is no number") from None
        found |= dict.fromkeys(sets.elements.get(block.option("ELSET"), ()), section)
    return found


def _shell(block: Block, rows: list[list[float]]) -> _Section:
    if "NODAL THICKNESS" in block.options:
        raise ReadError(f"{block.where}: a thickness by node {_ADVICE}")
    layers = rows if "COMPOSITE" in block.options else rows[:1]
    return _Section((sum(row[0] for row in layers),), _offsets(block, "OFFSET"))


def _beam(block: Block, rows: list[list[float]]) -> _Section:
    # CalculiX compares the first four letters: RECTANGULAR is RECT.
    kind = block.option("SECTION")[:4]
    if kind not in _SECTIONS:
        raise ReadError(f"{block.where}: the section {kind or '(unnamed)'} {_ADVICE}")
    # By default the first axis is -z.
    axis = tuple(rows[1][:3]) if len(rows) > 1 and len(rows[1]) > 2 else (0.0, 0.0, -1.0)
    # CalculiX makes a rectangle around a pipe, whose radius it has, and around a box, and integrates over the walls.
    sides = (2 * rows[0][0],) * 2 if kind == "PIPE" else (rows[0][0], rows[0][1])
    return _Section(sides, _offsets(block, "OFFSET1", "OFFSET2"), axis, kind == "CIRC")


def _offsets(block: Block, *names: str) -> tuple[float, ...]:
    return tuple(number_of(block.options.get(name) or "0") for name in names)
