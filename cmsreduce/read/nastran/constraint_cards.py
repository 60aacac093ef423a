"""Which constraint sets the case control of a deck selects.

Dofs that cards put in sets: constrained, dependent, and kept for the analysis.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.point_ids import Points, dof_keys, drop_trailing_reals, id_ranges

__all__ = [
    "CONSTRAINT_CARDS",
    "cards_in_force",
    "constrained_dofs",
    "dependent_dofs",
    "dependent_of",
    "named_sets",
    "selected_set",
]

_SUBCASE = re.compile(r"SUBCASE\b|SUBCOM\b|SYM\b", re.IGNORECASE)


def selected_set(lines: Sequence[str], keyword: str) -> tuple[int | None, str | None]:
    """Set number that SPC or MPC selects, and a remark if subcases differ.

    A selection above the subcases holds for all of them; a subcase may replace it. The first subcase counts.

    Parameters
    ----------
    lines : sequence of str
        Case control, upper case.
    keyword : str
        ``SPC`` or ``MPC``.

    Returns
    -------
    number : int or None
        None if nothing is selected, so that no such card is in force.
    remark : str or None
        Set where later subcases select another set.

    Examples
    --------
    >>> selected_set(["SPC = 3", "SUBCASE 1", "SPC = 5", "SUBCASE 2"], "SPC")
    (5, 'subcases select different SPC sets (5, 3): the first is taken')
    """
    pattern = re.compile(rf"{keyword}\s*=\s*(\d+)")
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


Keys = NDArray[np.int64]
Cards = Mapping[str, Sequence[Card]]

_LISTED = {"ASET1": "a", "BSET1": "b", "BNDFIX1": "b", "CSET1": "c", "BNDFRE1": "c", "OMIT1": "o", "QSET1": "q"}
_PAIRED = {"ASET": "a", "BSET": "b", "BNDFIX": "b", "CSET": "c", "BNDFREE": "c", "OMIT": "o", "QSET": "q"}
_PAIRED["SUPORT"] = "r"
_UNREAD = ("RSPLINE", "RTRPLT", "RTRPLT1", "RSSCON", "RBE2GS", "GENEL")
_RIGID = ("RBE1", "RBE2", "RBE3", "RBAR", "RBAR1", "RJOINT", "RROD")

CONSTRAINT_CARDS = frozenset({*_PAIRED, *_LISTED, *_UNREAD, *_RIGID, "SPC", "SPC1", "SPCADD", "MPC", "MPCADD"})
"""Cards these functions look at."""


def _join(parts: Sequence[Keys]) -> Keys:
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *parts]))


def named_sets(cards: Cards, points: Points) -> dict[str, Keys]:
    """Dofs of each set that cards name: a, b, c, o, q and r (supports); sets without cards are absent."""
    parts: dict[str, list[Keys]] = {}
    for name, letter in _PAIRED.items():
        for card in cards.get(name, ()):
            parts.setdefault(letter, []).append(dof_keys(card, points, 0, 4))
    for name, letter in _LISTED.items():
        for card in cards.get(name, ()):
            parts.setdefault(letter, []).append(points.keys(id_ranges(card, 1), card.text(0), card))
    return {letter: _join(found) for letter, found in parts.items()}


def cards_in_force(cards: Cards, case: Sequence[str] | None, keyword: str) -> tuple[set[int] | None, list[str]]:
    """Numbers of the SPC or MPC sets that are selected, None for all of them, and remarks."""
    if case is None:
        return None, []
    number, remark = selected_set(case, keyword)
    remarks = [] if remark is None else [remark]
    if number is None:
        return set(), remarks
    numbers = {number}
    for card in cards.get(f"{keyword}ADD", ()):
        if card.integer(0) == number:
            numbers.update(int(i) for span in id_ranges(card, 1) for i in span.ids())
    present = {card.integer(0) for name in (keyword, f"{keyword}1", f"{keyword}ADD") for card in cards.get(name, ())}
    if not numbers & present:
        remarks.append(f"case control selects {keyword} = {number}, which the deck does not have")
    return numbers, remarks


def constrained_dofs(cards: Cards, case: Sequence[str] | None, points: Points) -> tuple[Keys, list[str]]:
    """Dofs of the SPC and SPC1 cards in force, and remarks.

    Parameters
    ----------
    cards : mapping of name to cards
        Bulk data.
    case : sequence of str, optional
        Case control; if None every SPC set counts, otherwise the one it selects.
    points : Points
        Points of the deck.
    """
    numbers, remarks = cards_in_force(cards, case, "SPC")
    parts = [
        dof_keys(card, points, 1, 2, stride=3)
        for card in cards.get("SPC", ())
        if numbers is None or card.integer(0) in numbers
    ]
    parts += [
        points.keys(id_ranges(card, 2), card.text(1), card)
        for card in cards.get("SPC1", ())
        if numbers is None or card.integer(0) in numbers
    ]
    return _join(parts), remarks


def dependent_dofs(cards: Cards, case: Sequence[str] | None, points: Points) -> tuple[Keys, list[str]]:
    """Dofs that rigid elements and multipoint constraints make dependent, and remarks.

    RBE1, RBE2, RBE3, RBAR, RBAR1, RJOINT, RROD and MPC are read; other rigid elements are named in a remark.
    """
    parts = [dependent_of(card, points) for name in _RIGID for card in cards.get(name, ())]
    numbers, remarks = cards_in_force(cards, case, "MPC")
    parts += [
        dof_keys(card, points, 1, 1) for card in cards.get("MPC", ()) if numbers is None or card.integer(0) in numbers
    ]
    remarks += [
        f"{len(cards[name])} {name} cards are not understood: their dependent dofs stay in the sets n, f and a"
        for name in _UNREAD
        if name in cards
    ]
    return _join(parts), remarks


def dependent_of(card: Card, points: Points) -> Keys:
    """Keys of the dependent dofs of one rigid element.

    Raises
    ------
    ReadError
        If the card does not name them, or names points that are not there.
    """
    if card.name == "RBE2":
        return points.keys(id_ranges(card, 3, drop_trailing_reals(card)), card.text(2), card)
    if card.name in {"RBAR1", "RJOINT"}:
        return points.keys(id_ranges(card, 2, 3), card.text(3) or "123456", card)
    if card.name == "RBAR":
        return _bar(card, points)
    if card.name == "RROD":
        ends = [(index, card.text(index + 2)) for index in (1, 2)]
        return _join([points.keys(id_ranges(card, index, index + 1), c, card) for index, c in ends if c])
    if "UM" in card.fields:
        return _after_um(card, points)
    if card.name == "RBE3":
        return points.keys(id_ranges(card, 2, 3), card.text(3), card)
    raise ReadError(f"{card.where}: it has no UM field, so it has no dependent dofs")


def _bar(card: Card, points: Points) -> Keys:
    """Dependent dofs of an RBAR: those named, or else all that are not independent."""
    independent, dependent = (card.text(3), card.text(4)), (card.text(5), card.text(6))
    if not any(d.strip("0") for d in dependent):
        dependent = (_others(independent[0]), _others(independent[1]))
    return _join(
        [
            points.keys(id_ranges(card, index, index + 1), digits, card)
            for index, digits in zip((1, 2), dependent, strict=True)
            if digits.strip("0")
        ]
    )


def _others(digits: str) -> str:
    return "".join(c for c in "123456" if c not in digits)


def _after_um(card: Card, points: Points) -> Keys:
    """Dofs listed as (grid, components) behind the word UM."""
    fields = [text for text in card.fields[card.fields.index("UM") + 1 :] if text]
    if "ALPHA" in fields:
        fields = fields[: fields.index("ALPHA")]
    whole = [text for text in fields if text.isdigit()]
    pairs = Card(card.name, tuple(whole), card.path, card.line)
    return dof_keys(pairs, points, 0, len(whole) // 2)
