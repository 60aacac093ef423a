"""Elements that a NASTRAN deck states: their corners, sections and materials, as arrays.

`deck_mass` adds up their masses, `deck_energy` their strain energies.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.bars import offsets_of
from cmsreduce.read.nastran.cards import NO_CARDS, Card, Cards, CardTable, read_cards
from cmsreduce.read.nastran.deck_sections import SHAPED, Section, sections_of
from cmsreduce.read.nastran.frames import FRAME_CARDS, CoordinateSystem, FrameChain, frame_definitions
from cmsreduce.read.stated import NotCountedError

__all__ = [
    "LAYERED",
    "PLATES",
    "UNCOUNTED",
    "UNKNOWN",
    "Bar",
    "Elements",
    "Faces",
    "Material",
    "are_isotropic",
    "isotropic",
    "lame_of",
    "node_index",
    "properties_of",
    "stated_elements",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

UNKNOWN = (
    *("CQUAD8", "CQUADR", "CQUAD", "CTRIA6", "CTRIAR", "CSHEAR", "CTRIAX", "CTRIAX6", "CQUADX"),
    *("CTUBE", "CBEND", "CBEAM3"),
)
"""Elements that nothing here counts, with their nodes on their cards."""
UNCOUNTED = (*(*UNKNOWN, "PCOMPG", "MAT9", "PBCOMP", "PBRSECT", "PBMSECT", "BAROR", "BEAMOR", "DMIG"),)
"""Cards of mass and stiffness that nothing here counts."""

LAYERED = ("PCOMP", "MAT2", "MAT8")
"""Cards of plates that are counted at nodes alone."""

_BARS = {"CBAR": "PBAR", "CBEAM": "PBEAM", "CROD": "PROD", "CONROD": ""}
_SOLIDS = {"CTETRA": 4, "CPYRAM": 5, "CPENTA": 6, "CHEXA": 8}
PLATES = {"CTRIA3": 3, "CQUAD4": 4}
"""Plates and the number of their corners."""

_CARDS = (
    *(*_BARS, "PBAR", "PBEAM", "PROD", *SHAPED, *PLATES, *_SOLIDS, "PSHELL", "PSOLID", "MAT1", "PARAM"),
    # Cards of mass alone, then of stiffness alone.
    *("CONM1", "CONM2", "CMASS1", "CMASS2", "CMASS3", "CMASS4", "NSM", "NSM1", "NSML", "NSML1"),
    *("CELAS1", "CELAS2", "CELAS3", "CELAS4", "CBUSH", "CBUSH1D", "CBUSH2D", "CGAP", "CWELD", "CFAST", "CSEAM"),
    *("GENEL", "PMASS", "PELAS", "PBUSH", "PBUSHT", "MATT1", "MATT2", "MATT8", *LAYERED, *UNCOUNTED),
)
_CONSTRAINTS = ("MPC", "RBE1", "RBE2", "RBE3", "RBAR", "RBAR1", "RROD", "RTRPLT", "RSPLINE", "RSSCON", "RJOINT")
# A listing echoes the cards behind their count. A pattern that begins with one character is searched for quickly.
_STATED = re.compile(rb"\n(?: +\d+- {8})?(?:CONM[12]|MAT[128])\b", re.IGNORECASE)
# A static subcase whose stress stiffens the modes; the end of a case control; loads of such a subcase.
_STATIC = re.compile(rb"\n *STATSUB\b", re.IGNORECASE)
_CONTROL = re.compile(rb"\n *CEND\b", re.IGNORECASE)
_LOADS = re.compile(rb"\n(?:FORCE|MOMENT|PLOAD|TEMP|DEFORM|SPCD|GRAV|RFORCE|ACCEL)", re.IGNORECASE)
# Moduli that contradict each other by more make no isotropic material.
_ISOTROPIC = 1e-3


@dataclass(frozen=True)
class Material:
    """Isotropic material of a MAT1: Young's and shear modulus, Poisson's ratio, density."""

    E: float
    G: float
    nu: float
    density: float


@dataclass(frozen=True, eq=False)
class Bar:
    """A bar, beam or rod.

    Parameters
    ----------
    nodes : (2,) int64
        Positions of its grids among the nodes.
    ends : (2, 3) float64
        Its ends, with offsets, in basic.
    section : Section
        Section.
    pinned : bool
        True if an end is released in some component.
    card : Card
        Its card.
    """

    nodes: Indices
    ends: Array
    section: Section
    pinned: bool
    card: Card


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


class Elements:
    """Elements and materials on the cards of a deck, each kind made when it is first asked for.

    Parameters
    ----------
    cards : Cards
        Cards of the deck.
    nodes : Nodes
        Its grids.
    prestressed : bool
        True if matrices of the deck may have a stiffness by stress.

    Raises
    ------
    NotCountedError
        By a kind of elements, if a property is missing or an element is not counted: a plate with an offset or a
        thickness of its own, a solid with some of its nodes between corners only. Bars are counted one by one.
    """

    def __init__(self, cards: Cards, nodes: Nodes, prestressed: bool = False) -> None:
        self.cards, self.nodes, self.prestressed = cards, nodes, prestressed

    @property
    def constraints(self) -> list[CardTable]:
        """Cards of rigid elements and equations."""
        return [self.cards[name] for name in _CONSTRAINTS if name in self.cards]

    def system(self, number: int, where: str) -> CoordinateSystem:
        """Coordinate system that a card refers to.

        Raises
        ------
        NotCountedError
            If it is not defined, or goes through grids.
        """
        try:
            return self._systems.system(number, where)
        except ReadError as error:
            raise NotCountedError from error

    @cached_property
    def _systems(self) -> FrameChain:
        return FrameChain(frame_definitions(self.cards), {})

    @cached_property
    def materials(self) -> dict[int, Material]:
        """Materials by number; a blank modulus follows from the others, one that varies with temperature is unknown."""
        found = {}
        varied = {card.integer(0): card for card in self.cards.get("MATT1", ())}
        for card in self.cards.get("MAT1", ()):
            E, G, nu = card.real(1), card.real(2), card.real(3)
            if not card.text(1):
                E = 2 * (1 + nu) * G
            if not card.text(2):
                G = E / (2 * (1 + nu))
            if not card.text(3) and G:
                nu = E / (2 * G) - 1
            number = card.integer(0)
            density = card.real(4)
            if number in varied:
                E = np.nan if any(varied[number].text(k) for k in (1, 2, 3)) else E
                density = np.nan if varied[number].text(4) else density
            found[number] = Material(E, G, nu, density)
        return found

    @property
    def bars(self) -> tuple[Bar, ...]:
        """Bars, beams and rods whose section is known."""
        return self._bars[0]

    @property
    def loose_bars(self) -> Indices:
        """Positions (b, 2) of the nodes of the others: tapered, of another shape, or with ends along their own axes."""
        return self._bars[1]

    @cached_property
    def _bars(self) -> tuple[tuple[Bar, ...], Indices]:
        return _bars_of(self.cards, self.nodes)

    @cached_property
    def plates(self) -> tuple[Faces, ...]:
        """Triangles and quadrilaterals."""
        return tuple(_plates_of(self.cards, self.nodes))

    @cached_property
    def solids(self) -> tuple[Faces, ...]:
        """Tetrahedra, wedges and hexahedra, with or without nodes between corners."""
        return tuple(_solids_of(self.cards, self.nodes))


def stated_elements(path: Path, nodes: Nodes) -> Elements | None:
    """Elements of a deck that states masses or materials; None if the file is no deck, or holds superelements."""
    try:
        # A search of the bytes is fast, also in large decks without materials.
        text = b"\n" + path.read_bytes()
        if not _STATED.search(text):
            return None
        sections = read_cards(path, {*_CARDS, *_CONSTRAINTS, *FRAME_CARDS}).sections
    except (OSError, ReadError):
        return None
    # Without a case control, any load may have stressed the structure.
    prestressed = bool(_STATIC.search(text) or (not _CONTROL.search(text) and _LOADS.search(text)))
    return Elements(sections.get(0, {}), nodes, prestressed) if len(sections) <= 1 else None


def isotropic(number: int, materials: Mapping[int, Material]) -> Material:
    """Material by its number.

    Raises
    ------
    NotCountedError
        If there is none, or its moduli are not those of an isotropic one.
    """
    found = materials.get(number)
    if found is None or not _is_isotropic(found):
        raise NotCountedError
    return found


def are_isotropic(faces: Faces, field: int, materials: Mapping[int, Material]) -> NDArray[np.bool_]:
    """True for elements (e,) whose property names an isotropic material in a field."""

    def known(card: Card) -> float:
        made = materials.get(card.integer(field))
        return float(made is not None and _is_isotropic(made) and card.text(6) != "PFLUID")

    return faces.each(known) > 0


def _is_isotropic(material: Material) -> bool:
    return material.E > 0 and abs(2 * material.G * (1 + material.nu) / material.E - 1) <= _ISOTROPIC


def lame_of(material: Material) -> float:
    """First constant of Lame."""
    return material.E * material.nu / (1 + material.nu) / (1 - 2 * material.nu)


def node_index(nodes: Nodes, node: int) -> int:
    """Position of a grid.

    Raises
    ------
    NotCountedError
        If the deck has no such grid.
    """
    at = int(nodes.index(node)[0])
    if at < 0:
        raise NotCountedError
    return at


def _bars_of(cards: Cards, nodes: Nodes) -> tuple[tuple[Bar, ...], Indices]:
    sections = {(kind, number): made for kind, number, made in sections_of(cards)}
    bars, loose = [], []
    for name, kind in _BARS.items():
        for card in cards.get(name, ()):
            first, made = 2, sections.get((kind, card.integer(1, card.integer(0))))
            if name == "CONROD":
                rod = np.zeros((2, 2)), card.real(5), np.zeros(2), True
                made, first = Section(card.integer(3), card.real(4), *rod, card.real(7)), 1
            at = np.array([node_index(nodes, card.integer(first + k)) for k in range(2)])
            try:
                offsets = offsets_of(card) if name in ("CBAR", "CBEAM") else np.zeros((2, 3))
            except ReadError:
                made = None
            if made is None:
                loose.append(at)
                continue
            ends = nodes.xyz[at] + [nodes.frame[k].T @ w for k, w in zip(at, offsets, strict=True)]
            pinned = name in ("CBAR", "CBEAM") and any(card.text(k).strip("0") for k in (8, 9))
            bars.append(Bar(at, ends, made, pinned, card))
    return tuple(bars), np.array(loose, dtype=np.int64).reshape(-1, 2)


def _plates_of(cards: Cards, nodes: Nodes) -> Iterator[Faces]:
    made = {card.integer(0): card for card in cards.get("PSHELL", ())}
    for name, count in PLATES.items():
        found = cards.get(name, NO_CARDS)
        # After the corners: an angle of the material, then the element's own offset and thicknesses.
        if any(found.reals(k).any() for k in range(3 + count, found.width)):
            raise NotCountedError
        if len(found):
            ids = np.stack([found.integers(2 + k) for k in range(count)], axis=1)
            yield _faces(ids, np.zeros((len(ids), 0), dtype=np.int64), properties_of(found, made), made, nodes)


def _solids_of(cards: Cards, nodes: Nodes) -> Iterator[Faces]:
    made = {card.integer(0): card for card in cards.get("PSOLID", ())}
    all_edges = {4: 6, 5: 8, 6: 9, 8: 12}
    for name, count in _SOLIDS.items():
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
