"""Supports and rigid bodies of Abaqus and CalculiX input files, as far as they shape the rows of the matrices."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, DofTable
from cmsreduce.read.calculix_abaqus.decks import Block, DeckSets, blocks, deck_sets, element_nodes
from cmsreduce.read.printed_numbers import whole_number

__all__ = [
    "equations",
    "lost_masses",
    "nodes_with_own_rows",
    "places_of_means",
    "rotation_nodes",
    "supports",
    "turned_supports",
]

_NAMED = {
    "ENCASTRE": range(1, 7),
    "PINNED": range(1, 4),
    "XSYMM": (1, 5, 6),
    "YSYMM": (2, 4, 6),
    "ZSYMM": (3, 4, 5),
    "XASYMM": (2, 3, 4),
    "YASYMM": (1, 3, 5),
    "ZASYMM": (1, 2, 6),
}
"""Components that the named supports of Abaqus hold."""

# Of the distance of a point: nearer to a line, it lies on it.
_SAME_LINE = 1e-9


def supports(deck: Sequence[Block], sets: DeckSets, turning: Mapping[int, int]) -> dict[tuple[int, int], None]:
    """Nodes and components that *BOUNDARY holds.

    Parameters
    ----------
    deck : sequence of Block
        The input file.
    sets : DeckSets
        Its sets.
    turning : mapping of int to int
        Node that moves, by the number of the node whose components 1..3 are its rotations.

    Raises
    ------
    ReadError
        If a line names no components.
    """
    held: dict[tuple[int, int], None] = {}
    for block in deck:
        if block.keyword != "BOUNDARY":
            continue
        if block.option("OP") == "NEW":
            held.clear()
        for fields in block.rows:
            where, components = fields[0].strip('"').rpartition(".")[2], _components(block, fields)
            for node in sets.nodes_of(where):
                for component in components:
                    turns = node in turning and component <= 3
                    held[(turning[node], component + 3) if turns else (node, component)] = None
    return held


def turned_supports(
    deck: Sequence[Block],
    sets: DeckSets,
    held: Collection[tuple[int, int]],
    places: Mapping[int, Sequence[float]],
) -> dict[int, NDArray[np.float64]]:
    """Axes (3, 3) of nodes that *TRANSFORM turns and that are held along one or two of these axes.

    Parameters
    ----------
    deck : sequence of Block
        The input file.
    sets : DeckSets
        Its sets.
    held : collection of (int, int)
        Nodes and components of `supports`.
    places : mapping of int to sequence of float
        Positions of the nodes.

    Raises
    ------
    ReadError
        If a line of *TRANSFORM names no two points that give axes, or a node on the axis of a cylinder is held along a
        radius or across it.

    Notes
    -----
    The matrices of CalculiX are along the basic axes also at nodes of *TRANSFORM, which turns their supports alone. The
    proof of the row order refuses matrices along other axes.
    """
    turned = {
        node: block for block in deck if block.keyword == "TRANSFORM" for node in sets.nodes_of(block.option("NSET"))
    }
    found = {}
    for node, block in turned.items():
        along = {axis for axis in range(1, 7) if (node, axis) in held}
        # Held along all three axes, it is held along any.
        if all(len(along & axes) in (0, 3) for axes in ({1, 2, 3}, {4, 5, 6})) or node not in places:
            continue
        found[node] = _axes(block, np.array(places[node]))
        if not found[node].any(axis=1).all():
            if any(len(along & axes) == 1 for axes in ({1, 2}, {4, 5})):
                raise ReadError(
                    f"{block.where}: node {node} lies on the axis of the cylinder, where no radius is defined, and is "
                    "held along the radius or across it; hold it along axes of TYPE=R"
                )
            found[node][:2] = np.linalg.svd(found[node][2:])[2][1:]
    return found


def _axes(block: Block, at: NDArray[np.float64]) -> NDArray[np.float64]:
    """Axes of a *TRANSFORM at a place, as rows; on the axis of a cylinder the first two are zero."""
    try:
        a, b = np.array([float(text.replace("D", "E")) for text in next(block.rows)[:6]]).reshape(2, 3)
    except (StopIteration, ValueError):
        raise ReadError(f"{block.where}: its line needs two points, 6 numbers") from None
    # A cylinder has its axis from a to b; else a is a point on the first axis, and b one in the plane of the first two.
    round_axis = block.option("TYPE").startswith("C")
    first, second = (b - a, at - a) if round_axis else (a, b)
    length = float(np.linalg.norm(first))
    x = first / (length or 1.0)
    across = second - (second @ x) * x
    size = float(np.linalg.norm(across))
    off = size > _SAME_LINE * max(float(np.linalg.norm(second)), length)
    if not length or not (off or round_axis):
        raise ReadError(f"{block.where}: its two points give no axes; they lie on one line with the origin")
    y = across / size if off else np.zeros(3)
    return np.array([y, np.cross(x, y), x] if round_axis else [x, y, np.cross(x, y)])


def nodes_with_own_rows(deck: Sequence[Block], sets: DeckSets) -> set[int]:
    """Nodes of shells and beams that CalculiX keeps beside those that it makes: *CLOAD and *EQUATION name them.

    Notes
    -----
    Such a node moves with the mean of the nodes that it became.
    """
    found: set[int] = set()
    for block in deck:
        if block.keyword == "CLOAD":
            found.update(node for fields in block.rows for node in sets.nodes_of(fields[0]))
        elif block.keyword == "EQUATION":
            found.update(node for terms in _terms(block) for text in terms[::3] for node in sets.nodes_of(text))
    return found


def equations(path: Path) -> list[tuple[str, DofTable, NDArray[np.float64]]]:
    """Place, dofs and coefficients of each *EQUATION of a deck whose terms are single nodes."""
    found = []
    deck = list(blocks(path))
    sets = deck_sets(deck, {})
    for block in deck:
        for terms in _terms(block) if block.keyword == "EQUATION" else ():
            nodes = [sets.nodes_of(text.rpartition(".")[2]) for text in terms[::3]]
            components = [whole_number(text) for text in terms[1::3]]
            if any(len(each) != 1 for each in nodes) or not {*components} <= {*range(1, 7)}:
                continue
            # A dof may have several terms.
            sums: dict[int, float] = {}
            with suppress(ValueError):
                for (node,), component, text in zip(nodes, components, terms[2::3], strict=True):
                    key = node * KEY_STEP + (component or 0)
                    sums[key] = sums.get(key, 0.0) + float(text.replace("D", "E"))
                found.append((block.where, DofTable.from_keys(np.array([*sums])), np.array([*sums.values()])))
    return found


def _terms(block: Block) -> Iterator[list[str]]:
    """Node, component and coefficient of each term of the equations of a block, which follow their number of terms."""
    numbers, at = [text for fields in block.rows for text in fields if text], 0
    while at < len(numbers):
        count = whole_number(numbers[at])
        end = at + 1 + 3 * (len(numbers) if count is None else max(count, 0))
        yield numbers[at + 1 : end]
        at = end


def _components(block: Block, fields: list[str]) -> list[int]:
    """Components 1..6 of a line: its first and last one, or a name."""
    first = fields[1] if len(fields) > 1 else ""
    if first in _NAMED:
        return list(_NAMED[first])
    last = fields[2] if len(fields) > 2 and fields[2] else first
    try:
        return list(range(max(int(first), 1), min(int(last), 6) + 1))
    except ValueError:
        raise ReadError(f"{block.where}: '{', '.join(fields)}' is no support: node or set, first, last dof") from None


def rotation_nodes(deck: Sequence[Block], sets: DeckSets, last: int) -> dict[int, int]:
    """Reference node of each rigid body by the number of its rotations, whose rows CalculiX labels 1..3.

    Parameters
    ----------
    deck : sequence of Block
        The input file.
    sets : DeckSets
        Its sets.
    last : int
        The largest number of a node in the file; CalculiX goes on from there. It takes one number for the rotations
        of a body without ROT NODE, and one for each node that the body moves.
    """
    found: dict[int, int] = {}
    for block, reference, members in _rigid(deck, sets):
        turn = whole_number(block.option("ROT NODE") or "0")
        if turn is None:
            raise ReadError(f"{block.where}: ROT NODE is '{block.option('ROT NODE')[:40]}', which is no node")
        if not turn:
            last += 1
            turn = last
        last += len(members)
        found[turn] = reference
    return found


def lost_masses(deck: Sequence[Block], sets: DeckSets) -> list[int]:
    """Reference nodes of distributing couplings with a mass, which CalculiX leaves out of its matrices and modes."""
    found = {
        node
        for block, after in pairwise(deck)
        if (block.keyword, after.keyword) == ("COUPLING", "DISTRIBUTING")
        for node in sets.nodes_of(block.option("REF NODE").rpartition(".")[2])
    }
    masses = (block for block in deck if block.keyword == "ELEMENT" and block.option("TYPE") == "MASS")
    return sorted(found & {nodes[0] for block in masses for _, nodes in element_nodes(block, 1)})


def places_of_means(
    deck: Sequence[Block], sets: DeckSets, places: Mapping[int, Sequence[float]]
) -> dict[int, NDArray[np.float64]]:
    """Places (3,) at which the reference nodes of *DISTRIBUTING COUPLING move: the weighted mean of those of its nodes.

    Raises
    ------
    ReadError
        If a line names no nodes with a weight, or the weights are no positive sum.

    Notes
    -----
    CalculiX makes the displacement of the reference node the weighted mean, wherever it lies.
    """
    found: dict[int, NDArray[np.float64]] = {}
    for block in deck:
        if block.keyword != "DISTRIBUTING COUPLING":
            continue
        try:
            weights = [
                (node, float(fields[1].replace("D", "E"))) for fields in block.rows for node in sets.nodes_of(fields[0])
            ]
            at, weight = np.array([places[node] for node, _ in weights]), np.array([one for _, one in weights])
            if not weight.sum() > 0:
                raise ValueError
        except (IndexError, KeyError, ValueError):
            raise ReadError(
                f"{block.where}: a line needs a node or a set of nodes of the deck, and a weight above 0"
            ) from None
        for element in sets.elements.get(block.option("ELSET"), ()):
            found |= dict.fromkeys(sets.topology.get(element, ()), weight @ at / weight.sum())
    return found


def _rigid(deck: Sequence[Block], sets: DeckSets) -> Iterator[tuple[Block, int, tuple[int, ...]]]:
    """Rigid bodies and couplings in order of the file, each with its reference node and the nodes that it moves.

    The reference node of a distributing coupling has no rotations: CalculiX lets it move with the mean of the nodes.
    """
    for block, after in zip(deck, [*(block.keyword for block in deck[1:]), ""], strict=True):
        if block.keyword not in ("RIGID BODY", "COUPLING") or after == "DISTRIBUTING":
            continue
        text = block.option("REF NODE").rpartition(".")[2]
        reference = sets.nodes_of(text)
        if len(reference) != 1:
            if block.keyword == "RIGID BODY" and text:
                raise ReadError(f"{block.where}: '{text}' is no reference node")
            continue
        names = [name for key in ("NSET", "ELSET", "SURFACE") if (name := block.option(key))]
        yield block, reference[0], tuple(node for name in names for node in sets.nodes_of(name))
