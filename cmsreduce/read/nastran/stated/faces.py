"""Plates and solids of a NASTRAN deck, as arrays of one kind of card each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Nodes
from cmsreduce.read.nastran.cards import NO_CARDS, Card, Cards, CardTable
from cmsreduce.read.nastran.stated.materials import Material, is_compressible, is_isotropic
from cmsreduce.read.stated import NotCountedError, are_curved

__all__ = [
    "EDGES",
    "PLATES",
    "QUADRATIC",
    "SOLIDS",
    "Faces",
    "are_isotropic",
    "own_thickness",
    "plates_of",
    "properties_of",
    "solids_of",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PLATES, SOLIDS = {"CTRIA3": 3, "CQUAD4": 4}, {"CTETRA": 4, "CPYRAM": 5, "CPENTA": 6, "CHEXA": 8}
"""Plates and solids, and the number of their corners."""
QUADRATIC = {"CTRIA6": 3, "CQUAD8": 4}
"""Plates with nodes between corners, and the number of their corners."""

# Thickness of a plate of corners alone at the first of them, behind a flag.
_FIRST_THICKNESS = 10
# Angle of the material of plates with nodes between corners, by the number of corners.
_QUADRATIC_ANGLE = {3: 8, 4: 14}

EDGES = {
    4: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    5: ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    6: ((0, 1), (1, 2), (2, 0), (0, 3), (1, 4), (2, 5), (3, 4), (4, 5), (5, 3)),
    8: ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)),
}
"""Corners of each edge of solids, by the number of corners."""


@dataclass(frozen=True, eq=False)
class Faces:
    """Plates or solids of one kind of card.

    Parameters
    ----------
    nodes : (e, k) int64
        Positions of their corners among the nodes.
    between : (e, m) int64
        Positions of the nodes between corners; m = 0 for elements of corners alone.
    property : (e,) int64
        Position of the property of each among ``cards``.
    cards : sequence of Card
        PSHELL or PSOLID.
    corners : int
        Number of corners.
    thick : (e,) float64
        Thickness of plates; nothing of solids.
    """

    nodes: Indices
    between: Indices
    property: Indices
    cards: Sequence[Card]
    corners: int
    thick: Array

    def only(self, keep: NDArray[np.bool_]) -> Faces:
        """Some of the elements (e,)."""
        if keep.all():
            return self
        thick = self.thick[keep] if self.thick.size else self.thick
        return replace(
            self, nodes=self.nodes[keep], between=self.between[keep], property=self.property[keep], thick=thick
        )

    def each(self, value: Callable[[Card], float]) -> Array:
        """A value of the property of each element (e,); properties of no element are not read."""
        used, at = self._used
        return np.array([value(self.cards[k]) for k in used], dtype=np.float64)[at]

    @cached_property
    def _used(self) -> tuple[Indices, Indices]:
        return np.unique(self.property, return_inverse=True)


def are_isotropic(faces: Faces, field: int, materials: Mapping[int, Material]) -> NDArray[np.bool_]:
    """True for elements (e,) whose property names an isotropic material in a field."""

    def known(card: Card) -> float:
        made = materials.get(card.integer(field))
        return float(made is not None and is_isotropic(made) and is_compressible(made) and card.text(6) != "PFLUID")

    return faces.each(known) > 0


def own_thickness(found: CardTable, corners: int) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Thickness (e,) that triangles or quadrilaterals have of their own, 0 for that of the property.

    Then, True for those that are shares of the property's, and True for those that differ between corners.
    """
    if found.width <= _FIRST_THICKNESS:
        none = np.zeros(len(found), dtype=bool)
        return np.zeros(len(found)), none, none
    at = np.stack([found.reals(_FIRST_THICKNESS + k) for k in range(corners)], axis=1)
    flag = found.reals(_FIRST_THICKNESS - 1)
    return at[:, 0], flag == 1, np.asarray((at != at[:, :1]).any(axis=1) | ~np.isin(flag, (0, 1)))


def plates_of(cards: Cards, nodes: Nodes) -> Iterator[Faces]:
    """Plates of a PSHELL.

    Raises
    ------
    NotCountedError
        If one has an offset, a thickness that differs between corners, curved edges, or no property.
    """
    made = {card.integer(0): card for card in cards.get("PSHELL", ())}
    for name, count in (PLATES | QUADRATIC).items():
        found = cards.get(name, NO_CARDS)
        if not len(found):
            continue
        sides = count if name in QUADRATIC else 0
        if sides:
            # An offset, and thicknesses of corners.
            others = [k for k in range(2 + 2 * count, found.width) if k != _QUADRATIC_ANGLE[count]]
            own, shares, uneven = (np.zeros(len(found)), *(np.zeros(len(found), dtype=bool) for _ in range(2)))
        else:
            # After the corners: an angle of the material, then the element's own offset.
            others = [3 + count, _FIRST_THICKNESS - 2]
            own, shares, uneven = own_thickness(found, count)
        if uneven.any() or any(found.reals(k).any() for k in others if k < found.width):
            raise NotCountedError
        ids, more = (
            np.stack([found.integers(first + k) for k in range(many)], axis=1)
            if many
            else np.zeros((len(found), 0), int)
            for first, many in ((2, count), (2 + count, sides))
        )
        faces = _faces(ids, more, properties_of(found, made), made, nodes)
        around = np.array([(k, (k + 1) % count) for k in range(count)])
        if are_curved(nodes.xyz[faces.nodes], nodes.xyz[faces.between], around).any():
            raise NotCountedError
        thick = faces.each(lambda p: p.real(2))
        yield replace(faces, thick=np.where(own > 0, np.where(shares, own * thick, own), thick))


def solids_of(cards: Cards, nodes: Nodes) -> Iterator[Faces]:
    """Solids of a PSOLID, those with nodes between corners apart.

    Raises
    ------
    NotCountedError
        If one has some of its nodes between corners only, or no property.
    """
    made = {card.integer(0): card for card in cards.get("PSOLID", ())}
    all_edges = {4: 6, 5: 8, 6: 9, 8: 12}
    for name, count in SOLIDS.items():
        found = cards.get(name, NO_CARDS)
        if not len(found):
            continue
        properties = properties_of(found, made)
        ids = np.stack([found.integers(2 + k) for k in range(count)], axis=1)
        rest = range(2 + count, max(found.width, 3 + count))
        written = ~np.stack([found.blank(k) for k in rest], axis=1)
        counts = written.sum(axis=1)
        more = np.stack([found.integers(k, 0) for k in rest], axis=1) if counts.any() else written.astype(np.int64)
        if not np.isin(counts, (0, all_edges[count])).all():
            raise NotCountedError
        for between in (0, all_edges[count]):
            at = np.flatnonzero(counts == between)
            if at.size:
                yield _faces(ids[at], more[at][written[at]].reshape(at.size, between), properties[at], made, nodes)


def properties_of(found: CardTable, made: Mapping[int, Card]) -> Indices:
    """Position of the property of each element (e,); a blank one has the number of the element.

    Raises
    ------
    NotCountedError
        If a property is missing.
    """
    numbers = found.integers(1, 0)
    own = found.blank(1)
    if own.any():
        numbers[own] = found.integers(0)[own]
    used, at = np.unique(numbers, return_inverse=True)
    if not set(used.tolist()) <= made.keys():
        raise NotCountedError
    place = {number: k for k, number in enumerate(made)}
    return np.array([place[number] for number in used.tolist()], dtype=np.int64)[at]


def _faces(ids: Indices, more: Indices, properties: Indices, made: Mapping[int, Card], nodes: Nodes) -> Faces:
    at, between = nodes.index(ids.ravel()), nodes.index(more.ravel())
    if (at < 0).any() or (between < 0).any():
        raise NotCountedError
    return Faces(
        at.reshape(ids.shape), between.reshape(more.shape), properties, tuple(made.values()), ids.shape[1], np.zeros(0)
    )
