"""Stiffness of the bushes of a NASTRAN deck: springs in six directions between two points, or to the ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import cross_matrix
from cmsreduce.read.nastran.bars import orientation_of
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.stated.elements import Elements
from cmsreduce.read.stated import SAME_PLACE, NotCountedError

__all__ = ["stated_bushes"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Fields of a CBUSH: its two points, the system of its axes, its place between the points, the system of that place.
_ENDS, _AXES, _SHARE, _PLACE = (2, 3), 7, 8, 9
_PER_LINE = 8


def stated_bushes(elements: Elements) -> tuple[list[tuple[Array, Indices]], list[Indices]]:
    """Stiffness of each bush with its basic dofs, and the positions of the nodes of each that is not counted.

    Counted are places on the line of the two points, with axes along it or along a coordinate system.
    """
    found: list[tuple[Array, Indices]] = []
    others: list[Indices] = []
    rates = {card.integer(0): _rates(card) for card in elements.cards.get("PBUSH", ())}
    nodes, varied = elements.nodes, {card.integer(0) for card in elements.cards.get("PBUSHT", ())}
    same = SAME_PLACE * float(np.ptp(nodes.xyz, axis=0).max(initial=0.0))
    for card in elements.cards.get("CBUSH", ()):
        number = card.integer(1, card.integer(0))
        ids = [card.integer(k, 0) for k in _ENDS if card.integer(k, 0)]
        at = nodes.index(ids)
        rate = None if number in varied else rates.get(number)
        made = None if rate is None or (at < 0).any() else _stiffness(card, at, rate, elements, same)
        if made is None:
            others.append(at[at >= 0])
        else:
            found.append((made, (6 * at[:, None] + np.arange(6)).ravel()))
    return found, others


def _rates(card: Card) -> Array | None:
    """The six rates behind the word K of a PBUSH; None if they are no numbers."""
    rates = np.zeros(6)
    for first in range(1, len(card.fields), _PER_LINE):
        if card.text(first) == "K":
            try:
                rates = np.array([card.real(first + k) for k in range(1, 7)])
            except ReadError:
                return None
    return rates


def _stiffness(card: Card, at: Indices, rate: Array, elements: Elements, same: float) -> Array | None:
    """Stiffness (12, 12), or (6, 6) to the ground, along basic axes; None if its axes or its place are not read.

    Points no farther apart than ``same`` are at one place.
    """
    places = elements.nodes.xyz[at]
    apart = places[-1] - places[0]
    together = np.linalg.norm(apart) <= same
    if card.text(_PLACE) not in ("", "-1"):
        return None
    try:
        axes = _axes(card, at, None if together else apart, rate, elements)
    except NotCountedError:
        return None
    if axes is None:
        return None
    here = places[0] + card.real(_SHARE, 0.5) * apart
    moves = []
    for place, sign in zip(places, (-1.0, 1.0), strict=False):
        # The arms from the points to the bush are rigid.
        move = np.kron(np.eye(2), axes)
        move[:3, 3:] = -axes @ cross_matrix(here - place)
        moves.append(sign * move)
    both = np.hstack(moves)
    return np.asarray(both.T @ (rate[:, None] * both))


def _axes(card: Card, at: Indices, apart: Array | None, rate: Array, elements: Elements) -> Array | None:
    """Axes (3, 3) as rows."""
    if card.text(_AXES):
        system = elements.system(card.integer(_AXES), card.where)
        return np.asarray(system.displacement_axes(elements.nodes.xyz[at[:1]])[0])
    if apart is None:
        return None
    x = apart / np.linalg.norm(apart)
    alike = rate[1] == rate[2] and rate[4] == rate[5]
    if not card.text(4) and not any(card.real(k) for k in (5, 6)):
        if not alike:
            return None
        up = np.eye(3)[abs(x).argmin()]
    else:
        up = orientation_of(card, elements.nodes, int(at[0]))
    z = np.cross(x, up)
    if np.linalg.norm(z) <= SAME_PLACE * np.linalg.norm(up):
        return None
    z /= np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])
