"""Bars, beams, rods and springs of a NASTRAN deck with their sections and materials.

``read_bars`` reads what a geometric stiffness needs (CBAR, CBEAM, CROD, CONROD); ``read_members`` reads the whole
stiffness (CBAR, CROD, CONROD, CELAS1, CELAS2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Bars, Members, Nodes, Units
from cmsreduce.read.nastran.cards import FIELDS_PER_LINE, Card, Cards, read_cards

__all__ = ["bars_in_units", "offsets_of", "orientation_of", "read_bars", "read_members", "released_at"]

Array = NDArray[np.float64]

Properties = Mapping[str, Mapping[int, Card]]
"""Cards by name and number."""

Elastic = tuple[list[int], Array, Array, float, float, Array, Array, list[bool]]
"""Ends, offsets (2, 3), orientation, EA, GJ, EI (2, 2), 1 / (k G A) in both planes (2,), releases (12) of a bar."""

_ELEMENTS = ("CBAR", "CBEAM", "CROD", "CONROD")
_SECTIONS = {"CBAR": "PBAR", "CBEAM": "PBEAM", "CROD": "PROD"}
_BY_SHAPE = ("PBARL", "PBEAML", "PBCOMP", "PBRSECT", "PBMSECT")
# Elements that carry stress and are no bars: without them a geometric stiffness would be incomplete.
_STRESSED = (
    *("CQUAD4", "CQUAD8", "CQUADR", "CQUAD", "CTRIA3", "CTRIA6", "CTRIAR", "CSHEAR", "CTRIAX", "CTRIAX6", "CQUADX"),
    *("CHEXA", "CPENTA", "CTETRA", "CPYRAM", "CTUBE", "CBEND", "CBEAM3"),
)
_DEFAULTS = ("BAROR", "BEAMOR")
_STATION = ("YES", "YESA", "NO")
_SPRINGS = ("CELAS1", "CELAS2")
# Areas printed with five digits or more, at both ends of a straight section.
_ALIKE = 1e-4


def read_bars(path: Path) -> Bars:
    """Read the bars and beams of a deck, for their geometric stiffness.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.

    Returns
    -------
    Bars
        In the units of the deck, in its order by kind of card.

    Raises
    ------
    ReadError
        If there are none, a property or material is missing, or the geometric stiffness of bars does not describe the
        deck: it has releases other than hinges, tapered sections, or elements of other kinds under stress.
    """
    wanted = {*_ELEMENTS, *_SECTIONS.values(), "MAT1", *_BY_SHAPE, *_STRESSED, *_DEFAULTS}
    sections = {number: cards for number, cards in read_cards(path, wanted).sections.items() if cards}
    with_bars = {number: cards for number, cards in sections.items() if cards.keys() & set(_ELEMENTS)}
    if len(with_bars) != 1:
        found = "no CBAR, CBEAM, CROD or CONROD" if not with_bars else f"bars in superelements {sorted(with_bars)}"
        raise ReadError(
            f"{path}: {found}, so no geometric stiffness is computed from it; give the matrices themselves "
            "(`geometric_stiffness: {matrices: ...}`)" + ("" if not with_bars else ", or a deck of this body alone")
        )
    number, cards = next(iter(with_bars.items()))
    # Materials may be in the main bulk data.
    shared = {**sections.get(0, {}), **cards} if number else cards
    _refuse_others(cards)
    sections_by_key = _straight_sections(shared)
    moduli = {card.integer(0): _moduli(card) for card in shared.get("MAT1", ())}
    rows = [_bar(card, sections_by_key, moduli) for name in _ELEMENTS for card in cards.get(name, ())]
    ids, ends, EA, ratio, hinged, offset = zip(*rows, strict=True)
    hinges: NDArray[np.bool_] = np.array(hinged, dtype=np.bool_)
    return Bars(
        np.array(ids),
        np.array(ends),
        np.array(EA),
        np.array(ratio),
        np.logical_not(hinges.all(axis=1)),
        hinges,
        np.array(offset),
    )


def bars_in_units(bars: Bars, old: Units, new: Units) -> Bars:
    """Restate bars in another unit system."""
    length, force = old.length / new.length, old.force / new.force
    return replace(
        bars,
        EA=bars.EA * force,
        radius_squared=bars.radius_squared * length**2,
        offset=None if bars.offset is None else bars.offset * length,
    )


def _refuse_others(cards: Cards) -> None:
    remedy = "give the body's own matrices with `geometric_stiffness: {matrices: ...}`"
    for name in _STRESSED:
        if name in cards:
            raise ReadError(f"{cards[name][0].where}: geometric stiffness is computed for bars only; {remedy}")
    for name in _DEFAULTS:
        if name in cards:
            raise ReadError(f"{cards[name][0].where}: defaults of bars are not read; write them on each card")


def _bar(
    card: Card, sections: Mapping[tuple[str, int], Card], moduli: Mapping[int, tuple[float, float]]
) -> tuple[int, tuple[int, int], float, float, tuple[bool, bool], Array]:
    """Id, ends, EA, squared polar radius of the section, hinges and offsets of an element."""
    id, first = card.integer(0), 2
    if card.name == "CONROD":
        material, area, polar, first = card.integer(3), card.real(4), 0.0, 1
    else:
        key = (_SECTIONS[card.name], card.integer(1, id))
        if key not in sections:
            raise ReadError(f"{card.where}: there is no {key[0]} {key[1]} in the deck")
        section = sections[key]
        material, area = section.integer(1), section.real(2)
        polar = section.real(3) + section.real(4) if section.name != "PROD" else 0.0
    beam = card.name in ("CBAR", "CBEAM")
    E, _ = _of_material(card, material, moduli)
    hinged = _hinges(card) if beam else (True, True)
    if not area > 0 or not E > 0:
        raise ReadError(f"{card.where}: area {area:g} and modulus {E:g} must be positive")
    ends = (card.integer(first), card.integer(first + 1))
    ratio = 0.0 if all(hinged) else polar / area
    return id, ends, E * area, ratio, hinged, offsets_of(card) if beam else np.zeros((2, 3))


def offsets_of(card: Card) -> Array:
    """Offsets of the two ends of a CBAR or CBEAM from their grids (2, 3), along the grids' displacement axes.

    Raises
    ------
    ReadError
        If they are given along the axes of the bar.
    """
    offset = np.array([card.real(k) for k in range(10, 16)]).reshape(2, 3)
    if any("O" in card.text(7)[1 + end : 2 + end] for end in np.flatnonzero(offset.any(axis=1))):
        raise ReadError(
            f"{card.where} {card.integer(0)}: its offsets are along its own axes (OFFT {card.text(7)}); give them "
            "along the displacement axes of its grids, or the geometric stiffness itself (`matrices:`)"
        )
    return offset


def released_at(card: Card) -> list[set[str]]:
    """Components in which the two ends of a CBAR or CBEAM are free (pins), along its own axes."""
    return [set(card.text(k).replace("0", "")) for k in (8, 9)]


def _hinges(card: Card) -> tuple[bool, bool]:
    """True for each end that is free to turn across the bar; if both are, the bar stays straight, as a rod does."""
    pins = released_at(card)
    if any(pin and not {"5", "6"} <= pin <= {"4", "5", "6"} for pin in pins):
        raise ReadError(
            f"{card.where} {card.integer(0)}: its ends are released (pins) otherwise than in both bendings; no "
            "geometric stiffness is computed for that: give the matrices themselves"
        )
    return bool(pins[0]), bool(pins[1])


def _straight_sections(cards: Cards) -> dict[tuple[str, int], Card]:
    """Property cards by name and number; sections by shape and tapered beams are refused."""
    for name in _BY_SHAPE:
        if name in cards:
            raise ReadError(
                f"{cards[name][0].where}: sections are read from PBAR, PBEAM and PROD; write the area and "
                "moments of this one on such a card"
            )
    for card in cards.get("PBEAM", ()):
        area = card.real(2)
        for start in range(FIELDS_PER_LINE, len(card.fields), FIELDS_PER_LINE):
            if card.text(start) in _STATION and abs(card.real(start + 2, area) - area) > _ALIKE * abs(area):
                raise ReadError(
                    f"{card.where} {card.integer(0)}: its area changes along the beam; no geometric stiffness is "
                    "computed for that: cut it into straight beams, or give the matrices themselves"
                )
    return {(name, card.integer(0)): card for name in _SECTIONS.values() for card in cards.get(name, ())}


def read_members(path: Path, nodes: Nodes) -> Members:
    """Read the elastic members of a deck.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.
    nodes : Nodes
        Its grids, in its unit of length.

    Returns
    -------
    Members
        In the units of the deck, without elements of other kinds.

    Raises
    ------
    ReadError
        If a property, material, grid or orientation is missing, or a beam has another section than a CBAR.
    """
    sections = read_cards(path, {*_ELEMENTS, *_SPRINGS, "PBAR", "PROD", "PELAS", "MAT1"}).sections
    cards: Cards = next((one for _, one in sorted(sections.items()) if one.keys() & set(_ELEMENTS)), {})
    for card in cards.get("CBEAM", ()):
        raise ReadError(
            f"{card.where}: the motion of condensed dofs is found from CBAR, CROD and springs; write it as a CBAR, or "
            "give the full matrices, or the geometric stiffness itself (`matrices:`)"
        )
    moduli = {card.integer(0): _moduli(card) for card in cards.get("MAT1", ())}
    made = {name: {card.integer(0): card for card in cards.get(name, ())} for name in ("PBAR", "PROD", "PELAS")}
    rows = [_elastic_bar(card, made, moduli, nodes) for card in cards.get("CBAR", ())]
    rows += [_elastic_rod(card, made, moduli) for name in ("CROD", "CONROD") for card in cards.get(name, ())]
    springs = [_spring(card, made) for name in _SPRINGS for card in cards.get(name, ())]
    b, s = len(rows), len(springs)
    ends, offsets, ups, EA, GJ, EI, shear, released = zip(*rows, strict=True) if rows else ((),) * 8
    return Members(
        np.array(ends, dtype=np.int64).reshape(b, 2),
        np.array(offsets).reshape(b, 2, 3),
        np.array(ups).reshape(b, 3),
        np.array(EA),
        np.array(GJ),
        np.array(EI).reshape(b, 2, 2),
        np.array(shear).reshape(b, 2),
        np.array(released, dtype=bool).reshape(b, 12),
        np.array([k for k, _ in springs]),
        np.array([dofs for _, dofs in springs], dtype=np.int64).reshape(s, 2, 2),
    )


def _moduli(card: Card) -> tuple[float, float]:
    """E and G of a MAT1; a blank one follows from the other and nu."""
    E, G, nu = card.real(1), card.real(2), card.real(3)
    if not card.text(1):
        E = 2 * (1 + nu) * G
    if not card.text(2):
        G = E / (2 * (1 + nu))
    return E, G


def _property(card: Card, name: str, number: int, properties: Properties) -> Card:
    found = properties[name].get(number)
    if found is None:
        raise ReadError(f"{card.where}: there is no {name} {number} in the deck")
    return found


def _of_material(card: Card, number: int, moduli: Mapping[int, tuple[float, float]]) -> tuple[float, float]:
    if number not in moduli:
        raise ReadError(f"{card.where}: there is no MAT1 {number} in the deck")
    return moduli[number]


def _elastic_bar(
    card: Card, properties: Properties, moduli: Mapping[int, tuple[float, float]], nodes: Nodes
) -> Elastic:
    made = _property(card, "PBAR", card.integer(1, card.integer(0)), properties)
    E, G = _of_material(card, made.integer(1), moduli)
    A, I1, I2, J = (made.real(k) for k in (2, 3, 4, 5))
    K1, K2, I12 = (made.real(k) for k in (16, 17, 18))
    ends = [card.integer(2), card.integer(3)]
    at = nodes.index(ends)
    if (at < 0).any():
        raise ReadError(f"{card.where} {card.integer(0)}: the deck has no GRID {ends[int(at[0] >= 0)]}")
    offset = np.array([nodes.frame[k].T @ w for k, w in zip(at, offsets_of(card), strict=True)])
    shear = np.array([1 / (k * G * A) if k * G * A else 0.0 for k in (K1, K2)])
    pins = released_at(card)
    released = [str(c) in pins[end] for end in range(2) for c in range(1, 7)]
    EI = E * np.array([[I1, I12], [I12, I2]])
    return ends, offset, orientation_of(card, nodes, int(at[0])), E * A, G * J, EI, shear, released


def orientation_of(card: Card, nodes: Nodes, at: int) -> Array:
    """Orientation vector in basic, given as a vector at the first end or as a grid."""
    if card.text(4).isdigit() and not card.text(5):
        to = int(nodes.index(card.integer(4))[0])
        if to < 0:
            raise ReadError(f"{card.where} {card.integer(0)}: its orientation is given by GRID {card.text(4)}, missing")
        return np.asarray(nodes.xyz[to] - nodes.xyz[at])
    v = np.array([card.real(k) for k in (4, 5, 6)])
    if not v.any():
        raise ReadError(f"{card.where} {card.integer(0)}: it has no orientation vector")
    return v if card.text(7)[:1] == "B" else np.asarray(nodes.frame[at].T @ v)


def _elastic_rod(card: Card, properties: Properties, moduli: Mapping[int, tuple[float, float]]) -> Elastic:
    if card.name == "CONROD":
        first, material, A, J = 1, card.integer(3), card.real(4), card.real(5)
    else:
        made = _property(card, "PROD", card.integer(1, card.integer(0)), properties)
        first, material, A, J = 2, made.integer(1), made.real(2), made.real(3)
    E, G = _of_material(card, material, moduli)
    ends = [card.integer(first), card.integer(first + 1)]
    return ends, np.zeros((2, 3)), np.zeros(3), E * A, G * J, np.zeros((2, 2)), np.zeros(2), [False] * 12


def _spring(card: Card, properties: Properties) -> tuple[float, list[list[int]]]:
    if card.name == "CELAS2":
        k = card.real(1)
    else:
        k = _property(card, "PELAS", card.integer(1, card.integer(0)), properties).real(1)
    return k, [[card.integer(first, 0), card.integer(first + 1, 0)] for first in (2, 4)]
