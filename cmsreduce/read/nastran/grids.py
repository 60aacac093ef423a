"""GRID, GRDSET and SPOINT cards: positions of the points of a deck and the axes of their displacements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, Nodes
from cmsreduce.read.nastran.cards import Cards
from cmsreduce.read.nastran.dof_sets import Points, id_ranges
from cmsreduce.read.nastran.frames import FRAME_CARDS, FrameChain, Grid, frame_definitions
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = ["GRID_CARDS", "read_grids", "read_points", "scalar_points"]

# First field of (id, component) pairs, or of bare scalar ids, on elements that may make scalar points.
_SCALAR_PAIRS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (1, 2)}
_SCALAR_IDS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (3, 4)}
# Rounding is judged on this many grids spread over the deck, because one program prints all of them.
_SAMPLE = 2000

GRID_CARDS = FRAME_CARDS | {"GRID", "GRDSET", "SPOINT", *_SCALAR_PAIRS, *_SCALAR_IDS}
"""Cards that these functions use."""


def read_grids(cards: Cards) -> dict[int, Grid]:
    """Grids by id, in order of appearance.

    GRDSET fills the fields CP, CD and PS that are blank on a GRID; a zero there is a value and stays.

    Raises
    ------
    ReadError
        If a grid is defined twice with different data, or two GRDSET cards differ.
    """
    grdset = cards.get("GRDSET", ())
    filled = {(card.integer(1, 0), card.integer(5, 0), card.text(6)) for card in grdset} or {(0, 0, "")}
    if len(filled) > 1:
        raise ReadError(f"{grdset[1].where}: differs from the GRDSET before it; a deck may have only one")
    default_cp, default_cd, default_ps = filled.pop()
    out: dict[int, Grid] = {}
    for card in cards.get("GRID", ()):
        id = card.integer(0)
        if id <= 0:
            raise ReadError(f"{card.where}: {id} is no grid id; ids are positive")
        x = (card.real(2), card.real(3), card.real(4))
        cp, cd = card.integer(1, default_cp), card.integer(5, default_cd)
        ps = "".join(sorted(set((card.text(6) or default_ps).strip("0"))))
        if cd < 0:
            raise ReadError(f"{card.where}: grid {id} is a fluid point (CD = {cd}); acoustic models are not read")
        if any(c not in "123456" for c in ps):
            raise ReadError(f"{card.where}: '{ps}' in field 8 of grid {id} names no components; use digits 1 to 6")
        grid = Grid(cp, x, f"{card.where} {id}", cd, ps)
        before = out.setdefault(id, grid)
        if grid != before:
            raise ReadError(f"{card.where}: grid {id} differs from {before.where}; remove one of them")
    return out


def scalar_points(cards: Cards, grids: Mapping[int, Grid]) -> NDArray[np.int64]:
    """Sorted ids of scalar points, listed on SPOINT or implied by a spring, mass or damper that names one.

    Raises
    ------
    ReadError
        If an SPOINT has the id of a grid.
    """
    found: set[int] = set()
    for card in cards.get("SPOINT", ()):
        ids = {int(i) for span in id_ranges(card, 0) for i in span.ids(card)}
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
    # A zero is the ground.
    return np.array(sorted(found - grids.keys() - {0}), dtype=np.int64)


def read_points(cards: Cards) -> tuple[Nodes, Points, NDArray[np.int64]]:
    """Points of a section of bulk data.

    Returns
    -------
    nodes : Nodes
        Grids in order of appearance, coordinates in basic, displacement frames resolved.
    points : Points
        Ids of grids and scalar points.
    held : (k,) int64
        Keys of the dofs that GRID cards hold at zero (field PS).

    Raises
    ------
    ReadError
        If a card cannot be read, or a coordinate system is missing or defined by itself.
    """
    by_id = read_grids(cards)
    ids = np.fromiter(by_id, dtype=np.int64, count=len(by_id))
    grids = list(by_id.values())
    chain = FrameChain(frame_definitions(cards), by_id)
    x = np.array([grid.x for grid in grids]).reshape(-1, 3)
    spread = np.unique(np.linspace(0, max(len(grids) - 1, 0), min(len(grids), _SAMPLE)).astype(int))
    printed = np.zeros_like(x)
    printed[spread] = printed_rounding(x[spread])
    xyz, rounding = np.zeros_like(x), np.zeros(len(grids))
    for cp, at in _places([grid.cp for grid in grids]):
        system = chain.system(cp, grids[at[0]].where)
        xyz[at] = system.to_basic(x[at])
        rounding[at] = system.position_rounding(x[at], printed[at])
    frame, turn = np.zeros((len(grids), 3, 3)), np.zeros(len(grids))
    for cd, at in _places([grid.cd for grid in grids]):
        system = chain.system(cd, grids[at[0]].where)
        frame[at] = system.displacement_axes(xyz[at])
        turn[at] = system.axes_rounding(xyz[at], rounding[at])
    nodes = Nodes(ids, xyz, frame, float(rounding.max(initial=0.0)), float(turn.max(initial=0.0)))
    held = [id * KEY_STEP + int(c) for id, grid in by_id.items() for c in grid.ps]
    return nodes, Points(np.sort(ids), scalar_points(cards, by_id)), np.array(held, dtype=np.int64)


def _places(numbers: Sequence[int]) -> list[tuple[int, NDArray[np.int64]]]:
    """Places of each number in a list."""
    values = np.asarray(numbers, dtype=np.int64)
    return [(int(n), np.flatnonzero(values == n)) for n in np.unique(values)]
