"""Shells and beams as CalculiX solves them: each node becomes several nodes of solid elements.

CalculiX writes the expansion to a file ``.12d`` beside its matrices, and labels the rows of all the nodes that one node
became with the number of that node. Where normals differ, it ties them to the node by a rigid knot, which has three
rotations and a stretch.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import SCALAR
from cmsreduce.read.files import read_text
from cmsreduce.read.stated import NotCountedError

__all__ = ["PLANE", "ExpandedElement", "Expansion", "expanded_node", "expansion_beside", "solid_of_shell"]

_KNOT = re.compile(r"KNOT was generated in node\s+(\d+)")
_ELEMENT = re.compile(
    r'ELEMENT\s+(\d+) with label "([^"]*)" and with nodes:\s([\d\s]+?)is expanded into a "([^"]*)" element with '
    r"topology:\s([\d\s]+)"
)
# Nodes of the solid element at each node of a beam's two ends, then of its middle.
_BEAM_ENDS = ((0, 3, 4, 7, 11, 15, 16, 19), (1, 2, 5, 6, 9, 13, 17, 18))
_BEAM_MIDDLE = (8, 10, 12, 14)
_SHELLS_OR_BEAMS = "give shells or beams in its place, or leave it out and add a spring to the scene"
# Elements that CalculiX solves as one layer of solids, tied to move in a plane.
PLANE = ("CPS", "CAX")
# Kinds by the start of their label, and what to do.
_UNREAD = {
    "M": ("a membrane", _SHELLS_OR_BEAMS),
    "T": ("a truss", _SHELLS_OR_BEAMS),
    "CPS": ("a plane stress element", "mesh the body with shells, which move in space"),
    "CAX": ("an axisymmetric element", "mesh the whole body with solids, which move in space"),
}
# Numbers that CalculiX reserves for each node of a shell or a beam, once for each normal.
SHELL_NODES, BEAM_NODES = 3, 8


@dataclass(frozen=True)
class ExpandedElement:
    """A shell or a beam: its label, its nodes, and the nodes that each of them became, in ascending order.

    ``solid`` is the label of the solid element that it became, and ``corners`` are the first eight nodes of that.
    """

    number: int
    label: str
    nodes: tuple[int, ...]
    became: tuple[tuple[int, ...], ...]
    solid: str = ""
    corners: tuple[int, ...] = ()

    @property
    def beam(self) -> bool:
        """True for a beam or a truss."""
        return self.label[:1] in "BT"


@dataclass(frozen=True)
class Expansion:
    """Expansion of the shells and beams of a deck.

    Parameters
    ----------
    path : Path
        The file that states it.
    elements : tuple of ExpandedElement
        Every shell and beam.
    knots : tuple of int
        Nodes with a rigid knot.
    """

    path: Path
    elements: tuple[ExpandedElement, ...]
    knots: tuple[int, ...]

    @cached_property
    def nodes(self) -> Mapping[int, tuple[int, ...]]:
        """Nodes that each node of a shell or beam became, in ascending order."""
        found: dict[int, set[int]] = {}
        for element in self.elements:
            for node, ids in zip(element.nodes, element.became, strict=True):
                found.setdefault(node, set()).update(ids)
        return {node: tuple(sorted(ids)) for node, ids in found.items()}

    @cached_property
    def turning(self) -> Mapping[int, int]:
        """Knot by the number whose rows 1..3 are its rotations: the first one after its numbers."""
        last: dict[int, int] = {}
        for element in self.elements:
            reserved = BEAM_NODES if element.beam else SHELL_NODES
            for node, ids in zip(element.nodes, element.became, strict=True):
                last[node] = max(last.get(node, 0), ids[0] + reserved)
        return {last[knot]: knot for knot in self.knots if knot in last}

    def refuse_unread(self) -> None:
        """Refuse elements whose rows are others than those of shells and beams: membranes, trusses, plane ones.

        Raises
        ------
        ReadError
            With the first of them.
        """
        for element in self.elements:
            for start, (words, advice) in _UNREAD.items():
                if element.label.startswith(start):
                    raise ReadError(
                        f"{self.path}: element {element.number} is {words} ({element.label}), which is not read yet: "
                        f"{advice}"
                    )

    def relabelled(self, node: NDArray[np.int64], component: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
        """Labels of rows with the node that each row belongs to.

        Parameters
        ----------
        node, component : (n,) int64
            Labels as CalculiX writes them, in order of the rows.

        Returns
        -------
        node, component : (n,) int64
            A row that a support leaves of a node, so that nothing tells which of its nodes it belongs to, is scalar,
            with a number of its own.

        Raises
        ------
        ReadError
            If there are elements of `refuse_unread`.
        """
        self.refuse_unread()
        node, component = node.copy(), component.copy()
        placeless = [np.empty(0, dtype=np.int64)]
        for known, rows in _rows_by_node(node).items():
            if known not in self.nodes or known in self.knots:
                continue
            found = self._nodes_of(known, rows, component[rows])
            if found is None:
                placeless.append(rows)
            else:
                node[rows] = found
        for turn, knot in self.turning.items():
            # After the rotations of a knot comes the number of its stretch, which rigid motion leaves at rest.
            placeless.append(np.flatnonzero(node == turn + 1))
            component[node == turn] += 3
            node[node == turn] = knot
        scalar = np.concatenate(placeless)
        last = int(max(node.max(initial=0), *(ids[-1] for ids in self.nodes.values())))
        component[scalar] = SCALAR
        node[scalar] = last + 1 + np.arange(scalar.size)
        return node, component

    def _nodes_of(self, node: int, rows: NDArray[np.int64], component: NDArray[np.int64]) -> NDArray[np.int64] | None:
        """Node of each row with the label of one node; None if a support leaves rows that no rule explains."""
        ids = np.array(self.nodes[node])
        found = np.full(rows.size, node, dtype=np.int64)
        # A node of a solid has a row of its own, before those of all nodes that CalculiX makes.
        own = np.flatnonzero(np.diff(rows) != 1)
        made = np.arange(0 if not own.size else own[0] + 1, rows.size)
        for axis in (1, 2, 3):
            along = made[component[made] == axis]
            if along.size > ids.size:
                return None
            # Where a solid, a rigid body or a support leads the node, the first of its nodes follow the others.
            found[along] = ids[ids.size - along.size :]
        return found if (np.diff(found[made]) >= 0).all() else None


def _rows_by_node(node: NDArray[np.int64]) -> dict[int, NDArray[np.int64]]:
    """Rows with the label of each node, in ascending order."""
    order = np.argsort(node, kind="stable")
    ids, start = np.unique(node[order], return_index=True)
    return {int(one): rows for one, rows in zip(ids, np.split(order, start[1:]), strict=True)}


def expansion_beside(path: Path) -> Expansion | None:
    """The expansion of the job whose file is given, from the ``.12d`` of its stem; None if it has none.

    Raises
    ------
    ReadError
        If the file is damaged, or has an element of an unknown kind.
    """
    beside = next((found for suffix in (".12d", ".12D") if (found := path.with_suffix(suffix)).is_file()), None)
    if beside is None:
        return None
    text = read_text(beside) if beside.stat().st_size else ""
    elements = tuple(_expanded(beside, match) for match in _ELEMENT.finditer(text))
    return Expansion(beside, elements, tuple(map(int, _KNOT.findall(text)))) if elements else None


def expanded_node(path: Path, node: int) -> tuple[int, ...]:
    """Nodes that a node became in the job whose file is given, in ascending order; none if it stayed as it is."""
    expansion = expansion_beside(path)
    return () if expansion is None else expansion.nodes.get(node, ())


def _expanded(path: Path, match: re.Match[str]) -> ExpandedElement:
    nodes = tuple(map(int, match[3].split()))
    ids = [number for number in map(int, match[5].split()) if number]
    label, count = match[2].strip(), len(nodes)
    if label[:1] in "BT":
        places: tuple[tuple[int, ...], ...] = tuple(tuple(at for at in end if at < len(ids)) for end in _BEAM_ENDS)
        places = places if count == 2 else (places[0], _BEAM_MIDDLE, places[1])
    else:
        # Corners below, corners above, middles below, middles above, middles of the vertical edges.
        corners = count if len(ids) == 2 * count else count // 2
        vertical = range(4 * corners, 5 * corners) if len(ids) == 5 * corners else ()
        places = tuple((k, k + corners, *(at for at in vertical if at % corners == k)) for k in range(corners))
        places += tuple((2 * corners + k, 3 * corners + k) for k in range(count - corners))
    if len(places) != count or max(map(max, places)) >= len(ids):
        raise ReadError(
            f"{path}: element {match[1]} ({label}) with {count} nodes became a solid with {len(ids)}; expected are "
            "shells and beams. Give the .frd file with the expanded mesh"
        )
    became = tuple(tuple(sorted(ids[at] for at in one)) for one in places)
    return ExpandedElement(int(match[1]), label, nodes, became, match[4].split()[0], tuple(ids[:8]))


def solid_of_shell(shell: ExpandedElement | None, kind: str) -> list[int]:
    """Nodes of the solid that a shell became: corners below and above, middles of edges, middles across.

    Raises
    ------
    NotCountedError
        If CalculiX did not expand it.
    """
    corners = {"S6": 3, "S8": 4}.get(kind, int(kind[1]))
    if shell is None or len(shell.nodes) != int(kind[1]):
        raise NotCountedError
    at, edges = shell.became[:corners], shell.became[corners:]
    nodes = [*(ids[0] for ids in at), *(ids[-1] for ids in at), *(ids[0] for ids in edges), *(ids[-1] for ids in edges)]
    return nodes + [ids[1] for ids in at if len(ids) > 2]
