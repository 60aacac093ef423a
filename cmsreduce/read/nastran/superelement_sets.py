"""Superelements of a main deck: their boundary, and the dofs of their matrices (SESET, SEELT, SEBSET, SEQSET, CSUPER)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import KEY_STEP, SCALAR, DofTable
from cmsreduce.read.nastran.cards import Cards
from cmsreduce.read.nastran.dof_sets import Keys, Points, dof_keys, id_ranges, joined_keys

__all__ = ["SUPERELEMENT_CARDS", "modal_points", "superelement_sets"]

Element = tuple[int, Sequence[int]]
"""Number of an element, and its grids."""

_LETTERS = {"SEBSET": "b", "SECSET": "c", "SEQSET": "q", "SESUP": "r"}
_LISTED = {"SEBSET1": "b", "SECSET1": "c", "SEQSET1": "q"}
_TEN = 10  # a number above every component
_EXTERIOR = 2  # field of the first exterior point of a CSUPER

SUPERELEMENT_CARDS = frozenset({*_LETTERS, *_LISTED, "SESET", "SEELT", "CSUPER"})
"""Cards that these functions use."""


def superelement_sets(cards: Cards, points: Points, elements: Iterable[Element]) -> dict[int, dict[str, Keys]]:
    """Dof sets of every superelement that a deck makes by cards with its number.

    Parameters
    ----------
    cards : mapping of name to cards
        Main bulk data.
    points : Points
        Its grids and scalar points.
    elements : iterable of (int, sequence of int)
        Elements, rigid ones too.

    Returns
    -------
    dict of int to dict of str to (k,) int64
        Keys of the sets a, b, c, q and r by superelement, sorted; a has all of them.

    Raises
    ------
    ReadError
        If a card cannot be read.

    Notes
    -----
    The boundary of a superelement are the grids of its elements that are not inside it: not on its SESET, and for
    SEELT the grids that other elements share. An element belongs to the superelement of a grid inside. Boundary dofs
    that no card puts in another set are in the b-set. A CSUPER lists all points, with six dofs at each grid.
    """
    found: dict[int, dict[str, Keys]] = {}
    for number, letter, keys in _named(cards, points):
        own = found.setdefault(number, {})
        own[letter] = joined_keys([own.get(letter, keys), keys])
    inside = _inside(cards, points)
    named = {number: set((own_set // KEY_STEP).tolist()) for number, own in found.items() for own_set in [_held(own)]}
    boundary = _boundaries(cards, inside, named, list(elements))
    for number, grids in boundary.items():
        own = found.setdefault(number, {})
        every = (np.intersect1d(grids, points.grids)[:, None] * KEY_STEP + np.arange(1, 7)).ravel()
        taken = joined_keys([own[letter] for letter in "cr" if letter in own])
        own["b"] = joined_keys([own.get("b", taken[:0]), np.setdiff1d(every, taken)])
    # Generalised coordinates of a superelement go with its boundary, through the superelement in which that lies.
    for number, grids in boundary.items():
        for outer in {inside[grid] for grid in grids.tolist() if inside.get(grid)} & found.keys():
            kept = found[number].get("q", np.zeros(0, np.int64))
            kept = kept[[inside.get(point) != outer for point in (kept // KEY_STEP).tolist()]]
            found[outer]["b"] = joined_keys([found[outer].get("b", kept), kept])
    for card in cards.get("CSUPER", ()):
        ids = np.concatenate([span.ids(card) for span in id_ranges(card, _EXTERIOR)] or [np.zeros(0, np.int64)])
        grids, scalars = np.intersect1d(ids, points.grids), np.intersect1d(ids, points.scalars)
        six = (grids[:, None] * KEY_STEP + np.arange(1, 7)).ravel()
        found[card.integer(0)] = {"b": six, "q": scalars * KEY_STEP + SCALAR}
    return {
        number: {name: keys for name, keys in {"a": joined_keys(list(own.values())), **own}.items() if keys.size}
        for number, own in sorted(found.items())
        if number > 0
    }


def modal_points(table: DofTable, modal: NDArray[np.int64]) -> DofTable:
    """Table with the components of some grids as scalar points: 9990001.2 is point 99900012.

    Parameters
    ----------
    table : DofTable
        Dofs.
    modal : (k,) int64
        Grids whose components are generalised coordinates.
    """
    scalar = np.isin(table.node, modal) & (table.component > SCALAR)
    node = np.where(scalar, _TEN * table.node + table.component, table.node)
    return DofTable(node, np.where(scalar, np.int8(SCALAR), table.component).astype(np.int8))


def _named(cards: Cards, points: Points) -> Iterable[tuple[int, str, Keys]]:
    """Superelement, set and dofs of each card that names them."""
    for name, letter in _LETTERS.items():
        for card in cards.get(name, ()):
            yield card.integer(0), letter, dof_keys(card, points, 1, 3)
    for name, letter in _LISTED.items():
        for card in cards.get(name, ()):
            yield card.integer(0), letter, points.keys(id_ranges(card, 2), card.text(1), card)


def _inside(cards: Cards, points: Points) -> dict[int, int]:
    """Superelement of each grid that a SESET puts inside one."""
    found: dict[int, int] = {}
    for card in cards.get("SESET", ()):
        for span in id_ranges(card, 1):
            found |= dict.fromkeys(span.among(points.grids).tolist(), card.integer(0))
    return found


def _held(own: dict[str, Keys]) -> Keys:
    """Dofs of the boundary that cards name."""
    return joined_keys([own[letter] for letter in "bcr" if letter in own])


def _boundaries(
    cards: Cards, inside: dict[int, int], named: dict[int, set[int]], elements: Sequence[Element]
) -> dict[int, NDArray[np.int64]]:
    """Grids of the elements of each superelement that are not inside it; ``named`` are grids that cards put there."""
    known = np.unique(np.array([element for element, _ in elements], dtype=np.int64))
    given = {
        int(element): card.integer(0)
        for card in cards.get("SEELT", ())
        for span in id_ranges(card, 1)
        for element in span.among(known)
    }
    owners: dict[int, set[int]] = {}
    touched: dict[int, set[int]] = {}
    for element, grids in elements:
        number = given.get(element) or _owner(grids, inside, named)
        touched.setdefault(number, set()).update(grids)
        for grid in grids:
            owners.setdefault(grid, set()).add(number)
    # Without a SESET, the grids of a SEELT that other elements share are the boundary.
    by_grids = set(inside.values())
    return {
        number: np.array(
            sorted(grid for grid in grids if inside.get(grid) != number and (number in by_grids or owners[grid] != {number})),
            dtype=np.int64,
        )
        for number, grids in touched.items()
        if number > 0
    }


def _owner(grids: Sequence[int], inside: dict[int, int], named: dict[int, set[int]]) -> int:
    """Superelement of an element: of its grids, or of two the one that has the other's grid on its boundary."""
    numbers = sorted({inside[grid] for grid in grids if inside.get(grid)})
    for number in numbers if len(numbers) > 1 else ():
        if all(inside.get(grid) == number or grid in named.get(number, set()) for grid in grids):
            return number
    return numbers[0] if numbers else 0
