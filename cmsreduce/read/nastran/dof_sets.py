"""Ids and components on cards, and the dof sets that cards define: constrained dofs, and dofs of the analysis."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, SCALAR, each_once
from cmsreduce.read.nastran.cards import Card, Cards
from cmsreduce.read.printed_numbers import real_number

__all__ = [
    "SET_CARDS",
    "IdRange",
    "Keys",
    "Points",
    "cards_in_force",
    "constrained_dofs",
    "dof_keys",
    "drop_trailing_reals",
    "id_ranges",
    "joined_keys",
    "keys_without",
    "named_sets",
]

Keys = NDArray[np.int64]
"""Dofs as integers (``KEY_STEP``)."""

# Points that one range may define: a slip in a digit must not fill the memory.
_MOST_IDS = 1_000_000
_LONGEST_ID = 15
_SUBCASE = re.compile(r"SUBCASE\b|SUBCOM\b|SYM\b", re.IGNORECASE)
_LISTED = {"ASET1": "a", "BSET1": "b", "BNDFIX1": "b", "CSET1": "c", "BNDFRE1": "c", "OMIT1": "o", "QSET1": "q"}
_PAIRED = {"ASET": "a", "BSET": "b", "BNDFIX": "b", "CSET": "c", "BNDFREE": "c", "OMIT": "o", "QSET": "q"}
_PAIRED["SUPORT"] = "r"

SET_CARDS = frozenset({*_PAIRED, *_LISTED, "SPC", "SPC1", "SPCADD"})
"""Cards that these functions use."""


@dataclass(frozen=True)
class IdRange:
    """Ids from first to last in steps, without some of them."""

    first: int
    last: int
    step: int = 1
    without: tuple[int, ...] = ()

    @property
    def single(self) -> bool:
        """True if the range is one id."""
        return self.first == self.last

    def ids(self, card: Card) -> NDArray[np.int64]:
        """Every id of the range.

        Raises
        ------
        ReadError
            If there are absurdly many; ``card`` is named.
        """
        if (self.last - self.first) // self.step >= _MOST_IDS:
            raise ReadError(
                f"{card.where}: '{self.first} THRU {self.last}' is more than {_MOST_IDS} points; the file is damaged, "
                "or the range is a slip"
            )
        return np.setdiff1d(np.arange(self.first, self.last + 1, self.step, dtype=np.int64), self.without)

    def among(self, known: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sorted ids ``known`` that are in the range; the range is not expanded."""
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
                while at < len(fields) and _is_id(fields[at][1]) and first <= int(fields[at][1]) <= last:
                    without.append(int(fields[at][1]))
                    at += 1
        out.append(IdRange(first, last, step, tuple(without)))
    return out


def _after(card: Card, fields: list[tuple[int, str]], at: int) -> int:
    """Field that must follow a THRU or BY."""
    if at + 1 >= len(fields):
        raise ReadError(f"{card.where}: nothing follows '{fields[at][1]}'")
    return fields[at + 1][0]


def _is_id(text: str) -> bool:
    # Python refuses to convert thousands of digits.
    return text.isdecimal() and len(text) <= _LONGEST_ID


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

    def all_keys(self) -> Keys:
        """Keys of every dof: six of each grid, one of each scalar point."""
        six = (self.grids[:, None] * KEY_STEP + np.arange(1, 7)).ravel()
        return np.sort(np.concatenate([six, self.scalars * KEY_STEP + SCALAR]))

    def keys(self, ranges: list[IdRange], digits: str, card: Card) -> Keys:
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
                if not digits.strip("0") or any(c not in "123456" for c in digits):
                    raise ReadError(
                        f"{card.where}: '{digits}' names no components of grid {grids[0]}; use digits 1 to 6"
                    )
                components = np.array([int(c) for c in sorted(set(digits))])
                found.append((grids[:, None] * KEY_STEP + components).ravel())
        return np.concatenate(found)


def dof_keys(card: Card, points: Points, start: int, pairs: int, stride: int = 2) -> Keys:
    """Keys of the dofs on a card, such as ASET or SPC, of (id, components) pairs.

    Field ``start`` has the first id, and ``stride`` fields later comes the next; there are ``pairs`` of them at most.
    """
    found = [np.zeros(0, dtype=np.int64)]
    for index in range(start, start + pairs * stride, stride):
        if card.text(index):
            id = _id(card, index)
            found.append(points.keys([IdRange(id, id)], card.text(index + 1), card))
    return np.concatenate(found)


def drop_trailing_reals(card: Card) -> int:
    """Count of the fields before the real numbers at the end of a card, such as a thermal expansion."""
    stop = len(card.fields)
    while stop and not card.text(stop - 1).isdigit() and real_number(card.text(stop - 1)) is not None:
        stop -= 1
    return stop


def joined_keys(parts: Sequence[Keys]) -> Keys:
    """All keys of several lists, sorted, each once."""
    return each_once(np.concatenate([np.zeros(0, dtype=np.int64), *parts]))


def keys_without(keys: Keys, others: Keys) -> Keys:
    """Keys that are not among others; both are sorted, each key once."""
    if not others.size:
        return keys
    at = np.minimum(np.searchsorted(others, keys), others.size - 1)
    return np.asarray(keys[others[at] != keys])


def named_sets(cards: Cards, points: Points) -> dict[str, Keys]:
    """Dofs of each set that cards name: a, b, c, o, q and r (supports); sets without cards are absent."""
    parts: dict[str, list[Keys]] = {}
    for name, letter in _PAIRED.items():
        for card in cards.get(name, ()):
            parts.setdefault(letter, []).append(dof_keys(card, points, 0, 4))
    for name, letter in _LISTED.items():
        for card in cards.get(name, ()):
            parts.setdefault(letter, []).append(points.keys(id_ranges(card, 1), card.text(0), card))
    return {letter: joined_keys(found) for letter, found in parts.items()}


def cards_in_force(cards: Cards, case: Sequence[str] | None, *names: str) -> tuple[list[Card], list[str]]:
    """Constraint cards of the set that the case control selects, and remarks.

    Parameters
    ----------
    cards : mapping of name to cards
        Bulk data.
    case : sequence of str, optional
        Case control; without it all cards are in force.
    *names : str
        ``MPC``, or ``SPC`` and ``SPC1``; the first one is the keyword of the case control.
    """
    found = [card for name in names for card in cards.get(name, ())]
    if case is None:
        return found, []
    keyword = names[0]
    number, remark = _selected_set(case, keyword)
    remarks = [] if remark is None else [remark]
    if number is None:
        return [], remarks
    sums, numbers = cards.get(f"{keyword}ADD", ()), {number}
    for card in sums:
        if card.integer(0) == number:
            numbers.update(int(i) for span in id_ranges(card, 1) for i in span.ids(card))
    if not numbers & {card.integer(0) for card in (*found, *sums)}:
        remarks.append(f"case control selects {keyword} = {number}, which the deck does not have")
    return [card for card in found if card.integer(0) in numbers], remarks


def constrained_dofs(cards: Cards, case: Sequence[str] | None, points: Points) -> tuple[Keys, list[str]]:
    """Dofs of the SPC and SPC1 cards in force, and remarks."""
    found, remarks = cards_in_force(cards, case, "SPC", "SPC1")
    parts = [
        dof_keys(card, points, 1, 2, stride=3)
        if card.name == "SPC"
        else points.keys(id_ranges(card, 2), card.text(1), card)
        for card in found
    ]
    return joined_keys(parts), remarks


def _selected_set(lines: Sequence[str], keyword: str) -> tuple[int | None, str | None]:
    """Number of the set that SPC or MPC selects, None without one, and a remark if subcases differ.

    A selection above the subcases is valid for all of them; a subcase may replace it. The first subcase counts.

    Examples
    --------
    >>> _selected_set(["SPC = 3", "SUBCASE 1", "SPC = 5", "SUBCASE 2"], "SPC")
    (5, 'subcases select different SPC sets (5, 3): the first is taken')
    """
    pattern = re.compile(rf"{keyword}\s*=\s*(\d{{1,15}})(?!\d)")
    above: int | None = None
    cases: list[int | None] = []
    for line in lines:
        if _SUBCASE.match(line):
            cases.append(above)
            continue
        found = pattern.match(line)
        if found and cases:
            cases[-1] = int(found[1])
        elif found:
            above = int(found[1])
    if not cases:
        return above, None
    distinct = list(dict.fromkeys(cases))
    if len(distinct) == 1:
        return distinct[0], None
    listed = ", ".join("none" if number is None else str(number) for number in distinct)
    return cases[0], f"subcases select different {keyword} sets ({listed}): the first is taken"
