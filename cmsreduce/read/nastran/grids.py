"""GRID, GRDSET and SPOINT cards: positions of the points of a deck and the axes of their displacements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, Nodes
from cmsreduce.read.nastran.cards import NO_CARDS, Card, Cards, CardTable
from cmsreduce.read.nastran.dof_sets import Points, id_ranges
from cmsreduce.read.nastran.frames import FRAME_CARDS, FrameChain, Grid, frame_definitions, printed_by

__all__ = ["GRID_CARDS", "Grids", "read_grids", "read_points", "scalar_points"]

# First field of (id, component) pairs, or of bare scalar ids, on elements that may make scalar points.
_SCALAR_PAIRS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (1, 2)}
_SCALAR_IDS = {f"C{what}{kind}": 2 for what in ("ELAS", "MASS", "DAMP") for kind in (3, 4)}
# Rounding is judged on this many grids spread over the deck, because one program prints all of them.
_SAMPLE = 2000

GRID_CARDS = FRAME_CARDS | {"GRID", "GRDSET", "SPOINT", *_SCALAR_PAIRS, *_SCALAR_IDS}
"""Cards that these functions use."""


@dataclass(frozen=True, eq=False)
class Grids(Mapping[int, Grid]):
    """Grids of a deck in order of appearance: columns, and each grid by its id.

    Parameters
    ----------
    id, cp, cd : (n,) int64
        Id, system of the position, system of the displacements.
    x : (n, 3) float64
        Position in the system ``cp``.
    held : tuple of n str
        Components that are held at zero, as digits.
    cards : sequence of n Card
        Their cards.
    """

    id: NDArray[np.int64]
    cp: NDArray[np.int64]
    cd: NDArray[np.int64]
    x: NDArray[np.float64]
    held: tuple[str, ...]
    cards: Sequence[Card]

    @cached_property
    def _row(self) -> dict[int, int]:
        return dict(zip(self.id.tolist(), range(self.id.size), strict=True))

    def __getitem__(self, id: int) -> Grid:
        return self.at(self._row[id])

    def __iter__(self) -> Iterator[int]:
        return iter(self._row)

    def __len__(self) -> int:
        return len(self.id)

    def at(self, row: int) -> Grid:
        """Grid by its position."""
        x, y, z = self.x[row].tolist()
        where = f"{self.cards[row].where} {self.id[row]}"
        return Grid(int(self.cp[row]), (x, y, z), where, int(self.cd[row]), self.held[row], self.rounding(row))

    def rounding(self, row: int) -> tuple[float, ...]:
        """Rounding of the three coordinates as printed."""
        return printed_by(self.cards[row], 2, 5)


def read_grids(cards: Cards) -> Grids:
    """Grids of a section of bulk data.

    GRDSET fills the fields CP, CD and PS that are blank on a GRID; a zero there is a value and stays.

    Raises
    ------
    ReadError
        If a grid is defined twice with different data, or two GRDSET cards differ.
    """
    grdset = cards.get("GRDSET", NO_CARDS)
    filled = {(card.integer(1, 0), card.integer(5, 0), card.text(6)) for card in grdset} or {(0, 0, "")}
    if len(filled) > 1:
        raise ReadError(f"{grdset[1].where}: differs from the GRDSET before it; a deck may have only one")
    defaults = filled.pop()
    found = cards.get("GRID", NO_CARDS)
    try:
        grids = _grids_at_once(found, *defaults)
    except ReadError:
        # The first card that cannot be read is to blame, in whatever field.
        _each_grid(found, *defaults)
        raise
    usable = (grids.id > 0) & (grids.cd >= 0)
    ordered = np.sort(grids.id)
    once = (ordered[1:] > ordered[:-1]).all()
    if not usable.all() or not once or set("".join(set(grids.held))) - set("123456"):
        _each_grid(found, *defaults)
        first = np.sort(np.unique(grids.id, return_index=True)[1])
        held, kept = tuple(grids.held[k] for k in first), [found[k] for k in first]
        grids = Grids(grids.id[first], grids.cp[first], grids.cd[first], grids.x[first], held, kept)
    return grids


def _grids_at_once(found: CardTable, cp: int, cd: int, ps: str) -> Grids:
    texts, which = found.texts(6)
    held = ["".join(sorted(set((text or ps).strip("0")))) for text in texts]
    x = np.stack([found.reals(k) for k in (2, 3, 4)], axis=-1)
    return Grids(
        found.integers(0),
        found.integers(1, cp),
        found.integers(5, cd),
        x,
        tuple(held[k] for k in which.tolist()) if which.any() else (held[0],) * len(found),
        found,
    )


def _each_grid(found: CardTable, default_cp: int, default_cd: int, default_ps: str) -> None:
    """Refuse the first grid that is wrong, or differs from one before it."""
    out: dict[int, Grid] = {}
    for card in found:
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
    grids = read_grids(cards)
    chain = FrameChain(frame_definitions(cards), grids)
    x, count = grids.x, len(grids)
    spread = np.unique(np.linspace(0, max(count - 1, 0), min(count, _SAMPLE)).astype(int))
    printed = np.zeros_like(x)
    # A deck of scalar points has no grids.
    printed[spread] = np.reshape([grids.rounding(row) for row in spread.tolist()], (-1, 3))
    xyz, rounding = np.zeros_like(x), np.zeros(count)
    for cp, at in _places(grids.cp):
        system = chain.system(cp, grids.at(at[0]).where)
        xyz[at] = system.to_basic(x[at])
        rounding[at] = system.position_rounding(x[at], printed[at])
    frame, turn = np.zeros((count, 3, 3)), np.zeros(count)
    for cd, at in _places(grids.cd):
        system = chain.system(cd, grids.at(at[0]).where)
        frame[at] = system.displacement_axes(xyz[at])
        turn[at] = system.axes_rounding(xyz[at], rounding[at])
    nodes = Nodes(grids.id, xyz, frame, float(rounding.max(initial=0.0)), float(turn.max(initial=0.0)))
    some = zip(grids.id.tolist(), grids.held, strict=True) if any(grids.held) else ()
    held = [id * KEY_STEP + int(c) for id, ps in some for c in ps]
    return nodes, Points(np.sort(grids.id), scalar_points(cards, grids)), np.array(held, dtype=np.int64)


def _places(numbers: NDArray[np.int64]) -> list[tuple[int, NDArray[np.int64]]]:
    """Places of each number in a list."""
    return [(int(n), np.flatnonzero(numbers == n)) for n in np.unique(numbers)]
