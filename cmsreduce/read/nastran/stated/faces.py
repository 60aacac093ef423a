"""Plates and solids of a NASTRAN deck, as arrays of one kind of card each."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Nodes
from cmsreduce.read.nastran.cards import NO_CARDS, Card, Cards, CardTable
from cmsreduce.read.nastran.stated.materials import Material, is_isotropic
from cmsreduce.read.stated import NotCountedError

__all__ = ["EDGES", "PLATES", "SOLIDS", "Faces", "are_isotropic", "plates_of", "properties_of", "solids_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

PLATES, SOLIDS = {"CTRIA3": 3, "CQUAD4": 4}, {"CTETRA": 4, "CPYRAM": 5, "CPENTA": 6, "CHEXA": 8}
"""Plates and solids, and the number of their corners."""

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
    """

    nodes: Indices
    between: Indices
    property: Indices
    cards: Sequence[Card]
    corners: int

    def only(self, keep: NDArray[np.bool_]) -> Faces:
        """Some of the elements (e,)."""
        if keep.all():
            return self
        return replace(self, nodes=self.nodes[keep], between=self.between[keep], property=self.property[keep])

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
        return float(made is not None and is_isotropic(made) and card.text(6) != "PFLUID")

    return faces.each(known) > 0


def plates_of(cards: Cards, nodes: Nodes) -> Iterator[Faces]:
    """Plates of a PSHELL.

    Raises
    ------
    NotCountedError
        If one has an offset, an angle or a thickness of its own, or no property.
    """
    made = {card.integer(0): card for card in cards.get("PSHELL", ())}
    for name, count in PLATES.items():
        found = cards.get(name, NO_CARDS)
        # After the corners: an angle of the material, then the element's own offset and thicknesses.
        if any(found.reals(k).any() for k in range(3 + count, found.width)):
            raise NotCountedError
        if len(found):
            ids = np.stack([found.integers(2 + k) for k in range(count)], axis=1)
            yield _faces(ids, np.zeros((len(ids), 0), dtype=np.int64), properties_of(found, made), made, nodes)


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
    return Faces(at.reshape(ids.shape), between.reshape(more.shape), properties, tuple(made.values()), ids.shape[1])
