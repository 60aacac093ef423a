"""Superelements of a main deck, by cards with their number, and external ones: their boundary and the order of rows."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, SCALAR, DofTable, Nodes
from cmsreduce.read.formats import Geometry
from cmsreduce.read.nastran.cards import Card, CardFile, Cards, read_cards
from cmsreduce.read.nastran.dof_sets import Keys, Points, dof_keys, id_ranges, joined_keys
from cmsreduce.read.nastran.grids import GRID_CARDS, read_points

__all__ = ["SUPERELEMENT_CARDS", "modal_points", "read_extseout", "superelement_sets"]

Element = tuple[int, Sequence[int]]
"""Number of an element, and its grids."""

_LETTERS = {"SEBSET": "b", "SECSET": "c", "SEQSET": "q", "SESUP": "r"}
_LISTED = {"SEBSET1": "b", "SECSET1": "c", "SEQSET1": "q"}
_TEN = 10  # a number above every component
_ORDER_CARDS = GRID_CARDS | {"SECONCT", "EXTRN"}
_SECONCT_START = 8  # pairs of ids start on the second line
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
    found: dict[int, NDArray[np.int64]] = {}
    for number, all_of_it in touched.items():
        outer = [grid for grid in all_of_it if inside.get(grid) != number]
        shared = outer if number in by_grids else [grid for grid in outer if owners[grid] != {number}]
        if number > 0:
            found[number] = np.unique(np.array(shared, dtype=np.int64))
    return found


def _owner(grids: Sequence[int], inside: dict[int, int], named: dict[int, set[int]]) -> int:
    """Superelement of an element: of its grids, or of two the one that has the other's grid on its boundary."""
    numbers = sorted({inside[grid] for grid in grids if inside.get(grid)})
    for number in numbers if len(numbers) > 1 else ():
        if all(inside.get(grid) == number or grid in named.get(number, set()) for grid in grids):
            return number
    return numbers[0] if numbers else 0


def read_extseout(path: Path) -> Geometry:
    """Read the grids and the dof order of an external superelement.

    The punch file has both (EXTRN, and the grids after BEGIN SUPER). The assembly file gives the order on SECONCT,
    six dofs for each grid; it is used alone only if its folder has no punch file of the same stem.

    Parameters
    ----------
    path : Path
        ``.asm`` or ``.pch``.

    Returns
    -------
    Geometry
        Rows ``a`` in the order of the matrices. Sets ``b``: dofs of the interface grids, and ``q``: generalised
        coordinates, which are scalar points.

    Raises
    ------
    ReadError
        If a file is missing or damaged, or holds several superelements or none.
    """
    found = read_cards(path, _ORDER_CARDS)
    files = found.files
    chosen = _with_order(found, "EXTRN")
    if chosen is None:
        for beside in (path.with_suffix(".pch"), path.with_suffix(".PCH")):
            if beside != path and beside.is_file():
                punch = read_cards(beside, _ORDER_CARDS)
                chosen = _with_order(punch, "EXTRN")
                files = (*files, *punch.files)
                break
    if chosen is not None:
        return _superelement(*_from_extrn(chosen), files)
    chosen = _with_order(found, "SECONCT")
    if chosen is None:
        raise ReadError(f"{path}: neither EXTRN nor SECONCT in it: no external superelement")
    return _superelement(*_from_seconct(chosen), files)


def _with_order(found: CardFile, name: str) -> Cards | None:
    """The one section that has cards of a name, None if there is none."""
    sections = [cards for cards in found.sections.values() if name in cards]
    if not sections:
        return None
    numbers = {card.integer(0) for card in sections[0][name]} if name == "SECONCT" else {0}
    if len(sections) > 1 or len(numbers) > 1:
        raise ReadError(f"{found.path}: holds several superelements; name the .asm or .pch file of one")
    return sections[0]


def _from_extrn(cards: Cards) -> tuple[Nodes, Keys]:
    """Order from (id, components) pairs; a range of ids shares its components."""
    nodes, points, _ = read_points(cards)
    keys = [np.zeros(0, dtype=np.int64)]
    for card in cards["EXTRN"]:
        fields = [k for k, text in enumerate(card.fields) if text]
        while fields:
            length = 3 if len(fields) > 1 and card.text(fields[1]) == "THRU" else 1
            if len(fields) <= length:
                raise ReadError(f"{card.where}: no components follow {card.text(fields[0])}")
            ids = id_ranges(card.with_fields([card.text(k) for k in fields[:length]]), 0)
            keys.append(np.sort(points.keys(ids, card.text(fields[length]), card)))
            fields = fields[length + 1 :]
    return nodes, np.concatenate(keys)


def _from_seconct(cards: Cards) -> tuple[Nodes, Keys]:
    """Order from pairs of ids: the id in the superelement, and the id of the GRID to which it is connected."""
    nodes, points, _ = read_points(cards)
    keys = [np.zeros(0, dtype=np.int64)]
    own: dict[int, int] = {}
    for card in cards["SECONCT"]:
        for inner, outer in _pairs(card):
            if outer in points.grids or outer in points.scalars:
                own[outer] = inner
            elif inner not in points.grids and inner not in points.scalars:
                raise ReadError(f"{card.where} names {inner}, but there is no such GRID or SPOINT in the file")
            scalar = inner in points.scalars or outer in points.scalars
            keys.append(inner * KEY_STEP + (np.array([SCALAR]) if scalar else np.arange(1, 7)))
    renamed = np.array([own.get(int(id), int(id)) for id in nodes.id], dtype=np.int64)
    placed = Nodes(renamed, nodes.xyz, nodes.frame, nodes.xyz_rounding, nodes.frame_rounding)
    return placed, np.concatenate(keys)


def _pairs(card: Card) -> list[tuple[int, int]]:
    """Pairs of ids, with all ids of ranges: ``a b``, or ``a1 THRU a2 b1 THRU b2``."""
    fields = [text for text in card.fields[_SECONCT_START:] if text]
    spans = [span.ids(card) for span in id_ranges(card.with_fields(fields), 0)]
    if len(spans) % 2 or any(a.size != b.size for a, b in zip(spans[::2], spans[1::2], strict=True)):
        raise ReadError(f"{card.where}: ids do not come in pairs; the card is damaged")
    return [(int(a), int(b)) for A, B in zip(spans[::2], spans[1::2], strict=True) for a, b in zip(A, B, strict=True)]


def _superelement(nodes: Nodes, keys: Keys, files: tuple[Path, ...]) -> Geometry:
    scalar = keys % KEY_STEP == SCALAR
    sets = {name: DofTable.from_keys(part) for name, part in (("b", keys[~scalar]), ("q", keys[scalar])) if part.size}
    return Geometry(files[0], nodes, {"a": DofTable.from_keys(keys)}, sets, files=files)
