"""Bars and beams of a NASTRAN deck: CBAR, CBEAM, CROD and CONROD with their sections and materials."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Bars, Units
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import FIELDS_PER_LINE, Card

__all__ = ["bars_in_units", "offsets_of", "read_bars", "released_at"]

_ELEMENTS = ("CBAR", "CBEAM", "CROD", "CONROD")
_SECTIONS = {"CBAR": "PBAR", "CBEAM": "PBEAM", "CROD": "PROD"}
_BY_SHAPE = ("PBARL", "PBEAML", "PBCOMP", "PBRSECT", "PBMSECT")
# Elements that carry stress and are no bars: leaving them out would leave their geometric stiffness out.
_STRESSED = (
    *("CQUAD4", "CQUAD8", "CQUADR", "CQUAD", "CTRIA3", "CTRIA6", "CTRIAR", "CSHEAR", "CTRIAX", "CTRIAX6", "CQUADX"),
    *("CHEXA", "CPENTA", "CTETRA", "CPYRAM", "CTUBE", "CBEND", "CBEAM3"),
)
_DEFAULTS = ("BAROR", "BEAMOR")
_STATION = ("YES", "YESA", "NO")
# Areas printed with five digits or more, at both ends of a straight section.
_ALIKE = 1e-4

Cards = Mapping[str, Sequence[Card]]


@dataclass(frozen=True)
class _Section:
    material: int
    area: float
    polar: float


def read_bars(path: Path) -> Bars:
    """Bars and beams of a deck.

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
        If there are none, a property or material is missing, or the deck has what a bar's geometric stiffness does not
        describe: releases but hinges, tapered sections, elements of other kinds under stress.
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
    # Materials may stand in the main bulk data.
    shared = {**sections.get(0, {}), **cards} if number else cards
    _refuse_others(cards)
    properties, materials = _properties(shared), _moduli(shared)
    rows = [_bar(card, properties, materials) for name in _ELEMENTS for card in cards.get(name, ())]
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
            raise ReadError(f"{cards[name][0].where}: geometric stiffness is computed of bars alone; {remedy}")
    for name in _DEFAULTS:
        if name in cards:
            raise ReadError(f"{cards[name][0].where}: defaults of bars are not read; write them on each card")


def _bar(
    card: Card, properties: Mapping[tuple[str, int], _Section], moduli: Mapping[int, float]
) -> tuple[int, tuple[int, int], float, float, tuple[bool, bool], NDArray[np.float64]]:
    id = card.integer(0)
    if card.name == "CONROD":
        section, first = _Section(card.integer(3), card.real(4), 0.0), 1
    else:
        key = (_SECTIONS[card.name], card.integer(1, id))
        if key not in properties:
            raise ReadError(f"{card.where}: there is no {key[0]} {key[1]} in the deck")
        section, first = properties[key], 2
    if section.material not in moduli:
        raise ReadError(f"{card.where}: there is no MAT1 {section.material} in the deck")
    beam = card.name in ("CBAR", "CBEAM")
    hinged = _hinges(card) if beam else (True, True)
    area, E = section.area, moduli[section.material]
    if not area > 0 or not E > 0:
        raise ReadError(f"{card.where}: area {area:g} and modulus {E:g} must be positive")
    ends = (card.integer(first), card.integer(first + 1))
    ratio = 0.0 if all(hinged) else section.polar / area
    return id, ends, E * area, ratio, hinged, offsets_of(card) if beam else np.zeros((2, 3))


def offsets_of(card: Card) -> NDArray[np.float64]:
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


def released_at(card: Card) -> tuple[str, str]:
    """Components that the two ends of a CBAR or CBEAM are free in (pins), along its own axes."""
    first, second = (card.text(k).replace("0", "") for k in (8, 9))
    return first, second


def _hinges(card: Card) -> tuple[bool, bool]:
    """Whether each end is free to turn across the bar; where both are, it stays straight as a rod does."""
    pins = [set(pin) for pin in released_at(card)]
    if any(pin and not {"5", "6"} <= pin <= {"4", "5", "6"} for pin in pins):
        raise ReadError(
            f"{card.where} {card.integer(0)}: its ends are released (pins) otherwise than in both bendings; no "
            "geometric stiffness is computed for that: give the matrices themselves"
        )
    return bool(pins[0]), bool(pins[1])


def _properties(cards: Cards) -> dict[tuple[str, int], _Section]:
    for name in _BY_SHAPE:
        if name in cards:
            raise ReadError(
                f"{cards[name][0].where}: sections are read from PBAR, PBEAM and PROD; write the area and "
                "moments of this one on such a card"
            )
    found = {}
    for name in _SECTIONS.values():
        for card in cards.get(name, ()):
            polar = card.real(3) + card.real(4) if name != "PROD" else 0.0
            found[name, card.integer(0)] = _Section(card.integer(1), card.real(2), polar)
            if name == "PBEAM":
                _refuse_taper(card)
    return found


def _refuse_taper(card: Card) -> None:
    area = card.real(2)
    for start in range(FIELDS_PER_LINE, len(card.fields), FIELDS_PER_LINE):
        if card.text(start) in _STATION and abs(card.real(start + 2, area) - area) > _ALIKE * abs(area):
            raise ReadError(
                f"{card.where} {card.integer(0)}: its area changes along the beam; no geometric stiffness is "
                "computed for that: cut it into straight beams, or give the matrices themselves"
            )


def _moduli(cards: Cards) -> dict[int, float]:
    found = {}
    for card in cards.get("MAT1", ()):
        # E = 2 (1 + nu) G where only these are given.
        found[card.integer(0)] = card.real(1) if card.text(1) else 2 * (1 + card.real(3)) * card.real(2)
    return found
