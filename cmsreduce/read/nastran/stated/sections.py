"""Sections of the bars, beams and rods of a NASTRAN deck."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards import Card, Cards
from cmsreduce.read.stated import NotCountedError

__all__ = ["SHAPED", "Section", "sections_of"]

Array = NDArray[np.float64]

SHAPED = {"PBARL": "PBAR", "PBEAML": "PBEAM"}
"""Properties by shape, and those that have the same numbers."""
# Fields of PBAR, PBEAM and PROD: area, moments I1, I2, I12, torsion constant and non-structural mass per length.
_FIELDS = {"PBAR": (2, 3, 4, 18, 5, 6), "PBEAM": (2, 3, 4, 5, 6, 7), "PROD": (2, None, None, None, 3, 5)}
# Factors of the shear area: of a PBAR none by default, so that shear is not counted; of a PBEAM 1.
_SHEAR = {"PBAR": ((16, 17), 0.0), "PBEAM": ((), 1.0)}
# Stations with five digits or more.
_STRAIGHT = 1e-4
_LINE = 8
_STATION = ("YES", "YESA", "NO")
# Of a PBEAM after its stations: shear relief by taper, inertia of the mass per length, warping, and offsets of the mass
# and of the neutral axis.
_OTHER_AXES = range(2, 16)
_DIMENSIONS = {"ROD": 1, "TUBE": 2, "BAR": 2, "BOX": 4}
# Programs find the shear area of a section by its shape; where they differ, or it depends on the walls, the least.
_LEAST_SHEAR = {"ROD": 6 / 7, "TUBE": 0.5, "BAR": 5 / 6}


@dataclass(frozen=True, eq=False)
class Section:
    """Section of a bar.

    Parameters
    ----------
    material : int
        Number of its MAT1.
    area : float
        Area.
    moments : (2, 2) float64
        I1, I12; I12, I2.
    torsion : float
        Torsion constant; not a number (nan) where programs find different ones.
    shear : (2,) float64
        Factors of the area in shear; 0 for a bar without shear deflection.
    shear_known : bool
        True if the deck states them.
    per_length : float
        Mass per length that is no structure.
    """

    material: int
    area: float
    moments: Array
    torsion: float
    shear: Array
    shear_known: bool
    per_length: float


def sections_of(cards: Cards) -> Iterator[tuple[str, int, Section]]:
    """Kind, number and section of each property of bars, beams and rods.

    Left out are sections that are tapered, whose axes are apart, or of another shape than BAR, BOX, ROD and TUBE.
    """
    made = [(name, kind, _section_by_shape) for name, kind in SHAPED.items()]
    for name, kind, section in [*made, *((name, name, _section_by_numbers) for name in _FIELDS)]:
        for card in cards.get(name, ()):
            with contextlib.suppress(NotCountedError):
                yield kind, card.integer(0), section(card)


def _section_by_numbers(card: Card) -> Section:
    """Section of a PBAR, PROD, or PBEAM without taper."""
    area, first, second, mixed, twist, more = _FIELDS[card.name]
    I1, I2, I12 = (0.0 if k is None else card.real(k) for k in (first, second, mixed))
    shear, default = _SHEAR.get(card.name, ((), 0.0))
    if card.name == "PBEAM":
        shear = tuple(k + _after_stations(card) for k in range(2))
    factors = np.array([card.real(k, default) for k in shear]) if shear else np.zeros(2)
    moments = np.array([[I1, I12], [I12, I2]])
    own = card.real(area), moments, card.real(twist), factors, card.name != "PBEAM", card.real(more)
    return Section(card.integer(1), *own)


def _after_stations(card: Card) -> int:
    """First field of a PBEAM after its stations, all of which have the section of its first end.

    The line of points for stresses may be missing at every station, also at the first.
    """
    at = _LINE if card.text(_LINE) in _STATION else 2 * _LINE
    while card.text(at) in _STATION:
        # Behind the word and the place: area, moments, torsion constant and mass per length, as of the first end.
        values = [(card.real(k), card.real(at + k, card.real(k))) for k in range(2, _LINE)]
        if any(abs(here - first) > _STRAIGHT * abs(first) for first, here in values):
            raise NotCountedError
        at += 2 * _LINE if card.text(at) == "YES" else _LINE
    if any(card.real(at + k) for k in _OTHER_AXES):
        raise NotCountedError
    return at


def _section_by_shape(card: Card) -> Section:
    """Section of a PBARL or PBEAML of a simple shape without taper.

    ROD: radius. TUBE: outer and inner radius. BAR: width, height. BOX: width, height, walls above and beside.
    """
    shape = card.text(3)
    count = _DIMENSIONS.get(shape)
    # Fields after the dimensions and the non-structural mass are a second station of a beam.
    if count is None or any(card.text(k) for k in range(8 + count + 1, len(card.fields))):
        raise NotCountedError
    d = [card.real(8 + k) for k in range(count)]
    if shape in ("ROD", "TUBE"):
        inner = d[1] if shape == "TUBE" else 0.0
        area = np.pi * (d[0] ** 2 - inner**2)
        bending = (np.pi / 4 * (d[0] ** 4 - inner**4),) * 2
    else:
        w, h = (d[0] - 2 * d[3], d[1] - 2 * d[2]) if shape == "BOX" else (0.0, 0.0)
        area = d[0] * d[1] - w * h
        bending = ((d[0] * d[1] ** 3 - w * h**3) / 12, (d[1] * d[0] ** 3 - h * w**3) / 12)
    # The walls of a box along the force carry its shear.
    walls = [(d[0] - w) * h / area, (d[1] - h) * w / area] if shape == "BOX" else [_LEAST_SHEAR[shape]] * 2
    # Round sections alone have one torsion constant.
    twist = 2 * bending[0] if shape in ("ROD", "TUBE") else np.nan
    return Section(card.integer(1), float(area), np.diag(bending), twist, np.array(walls), False, card.real(8 + count))
