"""Elements that a NASTRAN deck states, of all kinds, each made when it is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.bars import offsets_of
from cmsreduce.read.nastran.cards import Card, Cards, CardTable, read_cards, texts_kept
from cmsreduce.read.nastran.frames import FRAME_CARDS, CoordinateSystem, FrameChain, frame_definitions
from cmsreduce.read.nastran.stated.faces import PLATES, QUADRATIC, SOLIDS, Faces, plates_of, solids_of
from cmsreduce.read.nastran.stated.materials import Material, materials_of
from cmsreduce.read.nastran.stated.sections import SHAPED, Section, sections_of
from cmsreduce.read.stated import NotCountedError

__all__ = ["LAYERED", "UNCOUNTED", "UNKNOWN", "Bar", "Elements", "node_index", "stated_elements"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

UNKNOWN = (
    *("CQUAD8", "CQUADR", "CQUAD", "CTRIA6", "CTRIAR", "CSHEAR", "CTRIAX", "CTRIAX6", "CQUADX"),
    *("CTUBE", "CBEND", "CBEAM3"),
)
"""Elements whose stiffness at nodes nothing here counts, with their nodes on their cards."""
UNCOUNTED = (
    *(name for name in UNKNOWN if name not in QUADRATIC),
    "PCOMPG",
    "MAT9",
    "PBCOMP",
    "PBRSECT",
    "PBMSECT",
    "BAROR",
    "BEAMOR",
    "DMIG",
)
"""Cards of mass and stiffness that nothing here counts."""

LAYERED = ("PCOMP", "MAT2", "MAT8")
"""Cards of plates that are counted at nodes alone."""

_BARS = {"CBAR": "PBAR", "CBEAM": "PBEAM", "CROD": "PROD", "CONROD": ""}
_CARDS = (
    *(*_BARS, "PBAR", "PBEAM", "PROD", *SHAPED, *PLATES, *SOLIDS, *QUADRATIC, "PSHELL", "PSOLID", "MAT1", "PARAM"),
    # Cards of mass alone, then of stiffness alone.
    *("CONM1", "CONM2", "CMASS1", "CMASS2", "CMASS3", "CMASS4", "NSM", "NSM1", "NSML", "NSML1"),
    *("CELAS1", "CELAS2", "CELAS3", "CELAS4", "CBUSH", "CBUSH1D", "CBUSH2D", "CGAP", "CWELD", "CFAST", "CSEAM"),
    *("SPOINT", "GENEL", "PMASS", "PELAS", "PBUSH", "PBUSHT", "MATT1", "MATT2", "MATT8", *LAYERED, *UNCOUNTED),
)
_CONSTRAINTS = ("MPC", "RBE1", "RBE2", "RBE3", "RBAR", "RBAR1", "RROD", "RTRPLT", "RSPLINE", "RSSCON", "RJOINT")
# A deck without any of these states neither mass nor stiffness.
_STATED = frozenset({"CONM1", "CONM2", "MAT1", "MAT2", "MAT8"})
# Loads of a static subcase, whose stress stiffens the modes.
_LOADS = ("FORCE", "MOMENT", "PLOAD", "TEMP", "DEFORM", "SPCD", "GRAV", "RFORCE", "ACCEL")


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
        By a kind of elements, if a property is missing or an element is not counted: a plate with an offset or
        corners of another thickness, a solid with some of its nodes between corners only. Bars are counted one by one.
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
        """Materials by number."""
        return materials_of(self.cards)

    @cached_property
    def anisotropic(self) -> dict[int, Card]:
        """Cards of MAT2 and MAT8 by number."""
        return {card.integer(0): card for name in ("MAT8", "MAT2") for card in self.cards.get(name, ())}

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
        return tuple(plates_of(self.cards, self.nodes))

    @cached_property
    def solids(self) -> tuple[Faces, ...]:
        """Tetrahedra, wedges and hexahedra, with or without nodes between corners."""
        return tuple(solids_of(self.cards, self.nodes))


def stated_elements(path: Path, nodes: Nodes) -> Elements | None:
    """Elements of a deck that states masses or materials; None if the file is no deck, or holds superelements."""
    try:
        with texts_kept():
            # The elements of a large deck without materials need not be read.
            if not read_cards(path, ()).names & _STATED:
                return None
            deck = read_cards(path, {*_CARDS, *_CONSTRAINTS, *FRAME_CARDS})
    except (OSError, ReadError):
        return None
    if len(deck.sections) > 1:
        return None
    if not deck.case_control:
        # Any load may have stressed the structure.
        prestressed = any(name.startswith(_LOADS) for name in deck.names)
    else:
        prestressed = any(line.startswith("STATSUB") for line in deck.case_control)
    return Elements(deck.sections.get(0, {}), nodes, prestressed)


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
