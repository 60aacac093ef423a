"""GRID, GRDSET, SPOINT and coordinate system cards: where the points of a deck are and how they move."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.frames import FrameChain, FrameDefinition, GridLocation
from cmsreduce.read.nastran.point_ids import KEY_STEP, id_ranges
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = [
    "GRID_CARDS",
    "GridCard",
    "frame_definitions",
    "grid_cards",
    "own_constraints",
    "place_nodes",
    "scalar_points",
]

_KINDS = {"R": "rectangular", "C": "cylindrical", "S": "spherical"}
_BY_POINTS = {f"CORD2{letter}": kind for letter, kind in _KINDS.items()}
_BY_GRIDS = {f"CORD1{letter}": kind for letter, kind in _KINDS.items()}
# First field of (id, component) pairs, or of bare scalar ids, on elements that may make scalar points.
_SCALAR_PAIRS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (1, 2)}
_SCALAR_IDS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (3, 4)}
# Rounding is judged on so many grids spread over the deck: all of them are printed by the same writer.
_SAMPLE = 2000

GRID_CARDS = frozenset({"GRID", "GRDSET", "SPOINT", *_BY_POINTS, *_BY_GRIDS, *_SCALAR_PAIRS, *_SCALAR_IDS})
"""Cards these functions look at."""


@dataclass(frozen=True)
class GridCard(GridLocation):
    """A GRID card with the defaults of GRDSET filled in.

    Adds the system its displacements are measured in, and the components it holds at zero itself.
    """

    cd: int
    ps: str


def grid_cards(cards: Mapping[str, Sequence[Card]]) -> dict[int, GridCard]:
    """Grids by id, in order of appearance.

    GRDSET fills the fields CP, CD and PS that are blank on a GRID; a zero there is a value and stays.

    Raises
    ------
    ReadError
        If a grid is defined twice with different data, or two GRDSET cards differ.
    """
    defaults = _grdset(cards.get("GRDSET", ()))
    out: dict[int, GridCard] = {}
    for card in cards.get("GRID", ()):
        id = card.integer(0)
        if id <= 0:
            raise ReadError(f"{card.where}: {id} is no grid id; ids are positive")
        x = (card.real(2), card.real(3), card.real(4))
        cp, cd = (card.integer(field, default) for field, default in ((1, defaults[0]), (5, defaults[1])))
        ps = (card.text(6) or defaults[2]).strip("0")
        if cd < 0:
            raise ReadError(f"{card.where}: grid {id} is a fluid point (CD = {cd}); acoustic models are not read")
        if any(c not in "123456" for c in ps):
            raise ReadError(f"{card.where}: '{ps}' in field 8 of grid {id} names no components; use digits 1 to 6")
        grid = GridCard(cp, x, f"{card.where} {id}", cd, ps)
        before = out.setdefault(id, grid)
        if (before.cp, before.x, before.cd, set(before.ps)) != (cp, x, cd, set(ps)):
            raise ReadError(f"{card.where}: grid {id} differs from {before.where}; remove one of them")
    return out


def _grdset(cards: Sequence[Card]) -> tuple[int, int, str]:
    """CP, CD and PS for grids that leave them blank."""
    found = [(card.integer(1, 0), card.integer(5, 0), card.text(6)) for card in cards]
    if len(set(found)) > 1:
        raise ReadError(f"{cards[1].where}: differs from the GRDSET before it; a deck may have only one")
    return found[0] if found else (0, 0, "")


def scalar_points(cards: Mapping[str, Sequence[Card]], grids: Mapping[int, GridCard]) -> NDArray[np.int64]:
    """Sorted ids of scalar points, listed on SPOINT or implied by a spring, mass or damper that names one.

    Raises
    ------
    ReadError
        If an SPOINT has the id of a grid.
    """
    found: set[int] = set()
    for card in cards.get("SPOINT", ()):
        ids = {int(i) for span in id_ranges(card, 0) for i in span.ids()}
        shared = ids & grids.keys()
        if shared:
            raise ReadError(f"{card.where}: {min(shared)} is a GRID as well ({grids[min(shared)].where})")
        found |= ids
    for name, start in _SCALAR_PAIRS.items():
        for card in cards.get(name, ()):
            for index in (start, start + 2):
                if card.text(index) and not card.text(index + 1).strip("0"):
                    found.add(card.integer(index))
    for name, start in _SCALAR_IDS.items():
        for card in cards.get(name, ()):
            found.update(card.integer(index) for index in (start, start + 1) if card.text(index))
    # A zero stands for the ground.
    return np.array(sorted(found - grids.keys() - {0}), dtype=np.int64)


def frame_definitions(cards: Mapping[str, Sequence[Card]]) -> dict[int, FrameDefinition]:
    """Coordinate systems by number.

    Raises
    ------
    ReadError
        If a system is defined twice with different data.
    """
    found: list[FrameDefinition] = []
    for name, kind in _BY_POINTS.items():
        for card in cards.get(name, ()):
            points = np.array([card.real(k) for k in range(2, 11)]).reshape(3, 3)
            found.append(FrameDefinition(card.integer(0), kind, card.where, card.integer(1, 0), points))
    for name, kind in _BY_GRIDS.items():
        for card in cards.get(name, ()):
            for start in (0, 4):
                if card.text(start):
                    grids = tuple(card.integer(start + k) for k in (1, 2, 3))
                    found.append(FrameDefinition(card.integer(start), kind, card.where, grids=grids))
    out: dict[int, FrameDefinition] = {}
    for frame in found:
        before = out.setdefault(frame.id, frame)
        if not frame.same_as(before):
            raise ReadError(f"{frame.where}: coordinate system {frame.id} differs from {before.where}")
    return out


def place_nodes(grids: Mapping[int, GridCard], chain: FrameChain) -> Nodes:
    """Coordinates in basic and displacement frames of all grids, in order of appearance.

    Raises
    ------
    ReadError
        If a grid refers to a coordinate system that is missing or cannot be resolved.
    """
    ids = np.fromiter(grids, dtype=np.int64, count=len(grids))
    cards = list(grids.values())
    x = np.array([grid.x for grid in cards]).reshape(-1, 3)
    spread = np.unique(np.linspace(0, max(len(cards) - 1, 0), min(len(cards), _SAMPLE)).astype(int))
    printed = np.zeros_like(x)
    printed[spread] = printed_rounding(x[spread])
    xyz, off = np.zeros_like(x), np.zeros(len(cards))
    for cp, rows in _grouped([grid.cp for grid in cards]):
        system = chain.system(cp, cards[rows[0]].where)
        xyz[rows] = system.to_basic(x[rows])
        off[rows] = system.position_rounding(x[rows], printed[rows])
    frame, turn = np.zeros((len(cards), 3, 3)), np.zeros(len(cards))
    for cd, rows in _grouped([grid.cd for grid in cards]):
        system = chain.system(cd, cards[rows[0]].where)
        frame[rows] = system.displacement_axes(xyz[rows])
        turn[rows] = system.axes_rounding(xyz[rows], off[rows])
    return Nodes(ids, xyz, frame, float(off.max(initial=0.0)), float(turn.max(initial=0.0)))


def _grouped(numbers: Sequence[int]) -> list[tuple[int, NDArray[np.int64]]]:
    """Positions of each number."""
    values = np.asarray(numbers, dtype=np.int64)
    return [(int(n), np.flatnonzero(values == n)) for n in np.unique(values)]


def own_constraints(grids: Mapping[int, GridCard]) -> NDArray[np.int64]:
    """Keys of the dofs that grids hold at zero themselves (their field PS)."""
    keys = [id * KEY_STEP + int(c) for id, grid in grids.items() for c in sorted(set(grid.ps))]
    return np.array(keys, dtype=np.int64)
