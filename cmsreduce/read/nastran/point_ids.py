"""Lists of grid and scalar point ids on cards, with THRU, BY and EXCEPT, and the dofs they name."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import SCALAR
from cmsreduce.read.nastran.cards import Card, real_number

__all__ = ["KEY_STEP", "IdRange", "Points", "dof_keys", "drop_trailing_reals", "id_ranges"]

KEY_STEP = 8
"""A dof is held as node * 8 + component, so that sorting keys sorts dofs as NASTRAN does."""


@dataclass(frozen=True)
class IdRange:
    """Ids from first to last in steps, without some of them."""

    first: int
    last: int
    step: int = 1
    without: tuple[int, ...] = ()

    @property
    def single(self) -> bool:
        """Whether it is one id."""
        return self.first == self.last

    def ids(self) -> NDArray[np.int64]:
        """Every id of the range."""
        return np.setdiff1d(np.arange(self.first, self.last + 1, self.step, dtype=np.int64), self.without)

    def among(self, known: NDArray[np.int64]) -> NDArray[np.int64]:
        """Those of the sorted ids ``known`` that lie in the range, without making the range itself."""
        here = known[np.searchsorted(known, self.first) : np.searchsorted(known, self.last, side="right")]
        return np.setdiff1d(here[(here - self.first) % self.step == 0], self.without)


def id_ranges(card: Card, start: int, stop: int | None = None) -> list[IdRange]:
    """Ids listed on a card from field ``start`` on: ``1 5 7 THRU 20 BY 2 EXCEPT 9 11``.

    Raises
    ------
    ReadError
        If a field is neither an id nor one of these words, or a range runs backwards.
    """
    fields = [(k, text) for k, text in enumerate(card.fields[:stop]) if k >= start and text]
    out: list[IdRange] = []
    at = 0

    def word(expected: str) -> bool:
        return at < len(fields) and fields[at][1] == expected

    while at < len(fields):
        first = last = _id(card, fields[at][0])
        step, without = 1, []
        at += 1
        if word("THRU"):
            last = _id(card, _after(card, fields, at))
            at += 2
            if last < first:
                raise ReadError(f"{card.where}: '{first} THRU {last}' runs backwards")
            if word("BY"):
                step = _id(card, _after(card, fields, at))
                at += 2
            if word("EXCEPT"):
                at += 1
                while at < len(fields) and fields[at][1].isdigit() and first <= int(fields[at][1]) <= last:
                    without.append(int(fields[at][1]))
                    at += 1
        out.append(IdRange(first, last, step, tuple(without)))
    return out


def _after(card: Card, fields: list[tuple[int, str]], at: int) -> int:
    """Field that must follow a THRU or BY."""
    if at + 1 >= len(fields):
        raise ReadError(f"{card.where}: nothing follows '{fields[at][1]}'")
    return fields[at + 1][0]


def _id(card: Card, index: int) -> int:
    value = card.integer(index)
    if value <= 0:
        raise ReadError(f"{card.where}: {value} is no id; ids are positive")
    return value


@dataclass(frozen=True, eq=False)
class Points:
    """The grids and scalar points of a deck.

    Parameters
    ----------
    grids, scalars : (k,) int64
        Sorted ids.
    """

    grids: NDArray[np.int64]
    scalars: NDArray[np.int64]

    def all_keys(self) -> NDArray[np.int64]:
        """Keys of every dof: six of each grid, one of each scalar point."""
        six = (self.grids[:, None] * KEY_STEP + np.arange(1, 7)).ravel()
        return np.sort(np.concatenate([six, self.scalars * KEY_STEP + SCALAR]))

    def keys(self, ranges: list[IdRange], digits: str, card: Card) -> NDArray[np.int64]:
        """Keys of the dofs that ids and component digits name.

        Raises
        ------
        ReadError
            If a single id is no point of the deck, or components are missing or wrong for a grid.
        """
        found = [np.zeros(0, dtype=np.int64)]
        for span in ranges:
            grids, scalars = span.among(self.grids), span.among(self.scalars)
            if span.single and not grids.size and not scalars.size:
                raise ReadError(
                    f"{card.where} names node {span.first}, but the deck has no such GRID or SPOINT; "
                    "check that all its files are included"
                )
            found.append(scalars * KEY_STEP + SCALAR)
            if grids.size:
                found.append((grids[:, None] * KEY_STEP + _components(digits, card, int(grids[0]))).ravel())
        return np.concatenate(found)


def _components(digits: str, card: Card, grid: int) -> NDArray[np.int64]:
    """Component numbers of a grid from a card's field."""
    if not digits.strip("0") or any(c not in "123456" for c in digits):
        raise ReadError(f"{card.where}: '{digits}' names no components of grid {grid}; use digits 1 to 6")
    return np.array([int(c) for c in sorted(set(digits))], dtype=np.int64)


def dof_keys(card: Card, points: Points, start: int, pairs: int, stride: int = 2) -> NDArray[np.int64]:
    """Keys of the dofs on a card of (id, components) pairs.

    Parameters
    ----------
    card : Card
        Such as ASET or SPC.
    points : Points
        Points of the deck.
    start : int
        Field of the first id.
    pairs : int
        Number of pairs at most.
    stride : int
        Fields from one id to the next.
    """
    found = [np.zeros(0, dtype=np.int64)]
    for index in range(start, start + pairs * stride, stride):
        if card.text(index):
            id = _id(card, index)
            found.append(points.keys([IdRange(id, id)], card.text(index + 1), card))
    return np.concatenate(found)


def drop_trailing_reals(card: Card) -> int:
    """Number of fields before the real numbers that end a card, such as a thermal expansion."""
    stop = len(card.fields)
    while stop and not card.text(stop - 1).isdigit() and real_number(card.text(stop - 1)) is not None:
        stop -= 1
    return stop
