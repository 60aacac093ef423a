"""Bars, rods and springs of a NASTRAN deck with all of their stiffness: CBAR, CROD, CONROD, CELAS1, CELAS2."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Members, Nodes
from cmsreduce.read.nastran.bar_cards import offsets_of, released_at
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import Card

__all__ = ["read_members"]

Array = NDArray[np.float64]
Cards = Mapping[str, Sequence[Card]]

_BARS, _RODS = ("CBAR",), ("CROD", "CONROD")
_SPRINGS = ("CELAS1", "CELAS2")
_PROPERTIES = ("PBAR", "PROD", "PELAS", "MAT1")


@dataclass(frozen=True)
class _Elastic:
    """What a bar is made of: EA, GJ, EI (2, 2) and 1 / (k G A) of both planes."""

    EA: float
    GJ: float
    EI: Array
    shear: Array


def read_members(path: Path, nodes: Nodes) -> Members:
    """Elastic members of a deck.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.
    nodes : Nodes
        Its grids, in its unit of length.

    Returns
    -------
    Members
        In the units of the deck. Elements of other kinds are left out.

    Raises
    ------
    ReadError
        If a property, material, grid or orientation is missing, or there are beams whose section is not that of a CBAR.
    """
    sections = read_cards(path, {*_BARS, *_RODS, *_SPRINGS, *_PROPERTIES, "CBEAM"}).sections
    cards = next((one for _, one in sorted(sections.items()) if one.keys() & {*_BARS, *_RODS, "CBEAM"}), {})
    for card in cards.get("CBEAM", ()):
        raise ReadError(
            f"{card.where}: the motion of condensed dofs is found from CBAR, CROD and springs; write it as a CBAR, or "
            "give the full matrices, or the geometric stiffness itself (`matrices:`)"
        )
    moduli = {card.integer(0): _moduli(card) for card in cards.get("MAT1", ())}
    rows = [_bar(card, cards, moduli, nodes) for card in cards.get("CBAR", ())]
    rows += [_rod(card, cards, moduli) for name in _RODS for card in cards.get(name, ())]
    springs = [_spring(card, cards) for name in _SPRINGS for card in cards.get(name, ())]
    b, s = len(rows), len(springs)
    ends, offsets, ups, made, released = zip(*rows, strict=True) if rows else ((),) * 5
    return Members(
        np.array(ends, dtype=np.int64).reshape(b, 2),
        np.array(offsets).reshape(b, 2, 3),
        np.array(ups).reshape(b, 3),
        np.array([one.EA for one in made]),
        np.array([one.GJ for one in made]),
        np.array([one.EI for one in made]).reshape(b, 2, 2),
        np.array([one.shear for one in made]).reshape(b, 2),
        np.array(released, dtype=bool).reshape(b, 12),
        np.array([k for k, _ in springs]),
        np.array([dofs for _, dofs in springs], dtype=np.int64).reshape(s, 2, 2),
    )


def _moduli(card: Card) -> tuple[float, float]:
    """E and G, the one that is blank from the others."""
    E, G, nu = card.real(1), card.real(2), card.real(3)
    if not card.text(1):
        E = 2 * (1 + nu) * G
    if not card.text(2):
        G = E / (2 * (1 + nu))
    return E, G


def _property(card: Card, name: str, number: int, cards: Cards) -> Card:
    found = next((one for one in cards.get(name, ()) if one.integer(0) == number), None)
    if found is None:
        raise ReadError(f"{card.where}: there is no {name} {number} in the deck")
    return found


def _of_material(card: Card, number: int, moduli: Mapping[int, tuple[float, float]]) -> tuple[float, float]:
    if number not in moduli:
        raise ReadError(f"{card.where}: there is no MAT1 {number} in the deck")
    return moduli[number]


def _bar(
    card: Card, cards: Cards, moduli: Mapping[int, tuple[float, float]], nodes: Nodes
) -> tuple[list[int], Array, Array, _Elastic, list[bool]]:
    made = _property(card, "PBAR", card.integer(1, card.integer(0)), cards)
    E, G = _of_material(card, made.integer(1), moduli)
    A, I1, I2, J = (made.real(k) for k in (2, 3, 4, 5))
    K1, K2, I12 = (made.real(k) for k in (16, 17, 18))
    ends = [card.integer(2), card.integer(3)]
    at = nodes.index(ends)
    if (at < 0).any():
        raise ReadError(f"{card.where} {card.integer(0)}: the deck has no GRID {ends[int(at[0] >= 0)]}")
    offset = np.array([nodes.frame[k].T @ w for k, w in zip(at, offsets_of(card), strict=True)])
    stiff = np.array([1 / (k * G * A) if k * G * A else 0.0 for k in (K1, K2)])
    elastic = _Elastic(E * A, G * J, E * np.array([[I1, I12], [I12, I2]]), stiff)
    pins = released_at(card)
    released = [str(c) in pins[end] for end in range(2) for c in range(1, 7)]
    return ends, offset, _up(card, nodes, int(at[0])), elastic, released


def _up(card: Card, nodes: Nodes, at: int) -> Array:
    """Orientation vector in basic: a vector at the first end, or to a grid."""
    if card.text(4).isdigit() and not card.text(5):
        to = int(nodes.index(card.integer(4))[0])
        if to < 0:
            raise ReadError(f"{card.where} {card.integer(0)}: its orientation is given by GRID {card.text(4)}, missing")
        return np.asarray(nodes.xyz[to] - nodes.xyz[at])
    v = np.array([card.real(k) for k in (4, 5, 6)])
    if not v.any():
        raise ReadError(f"{card.where} {card.integer(0)}: it has no orientation vector")
    return v if card.text(7)[:1] == "B" else np.asarray(nodes.frame[at].T @ v)


def _rod(
    card: Card, cards: Cards, moduli: Mapping[int, tuple[float, float]]
) -> tuple[list[int], Array, Array, _Elastic, list[bool]]:
    if card.name == "CONROD":
        first, material, A, J = 1, card.integer(3), card.real(4), card.real(5)
    else:
        made = _property(card, "PROD", card.integer(1, card.integer(0)), cards)
        first, material, A, J = 2, made.integer(1), made.real(2), made.real(3)
    E, G = _of_material(card, material, moduli)
    elastic = _Elastic(E * A, G * J, np.zeros((2, 2)), np.zeros(2))
    return [card.integer(first), card.integer(first + 1)], np.zeros((2, 3)), np.zeros(3), elastic, [False] * 12


def _spring(card: Card, cards: Cards) -> tuple[float, list[list[int]]]:
    if card.name == "CELAS2":
        k = card.real(1)
    else:
        k = _property(card, "PELAS", card.integer(1, card.integer(0)), cards).real(1)
    return k, [[card.integer(first, 0), card.integer(first + 1, 0)] for first in (2, 4)]
