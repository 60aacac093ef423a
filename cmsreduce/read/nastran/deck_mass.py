"""Mass and centre of mass that a NASTRAN deck states: bars, rods, plates, solids and point masses."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.bars import offsets_of
from cmsreduce.read.nastran.cards import Card, Cards, read_cards

__all__ = ["deck_mass"]

Array = NDArray[np.float64]

_BARS = {"CBAR": "PBAR", "CBEAM": "PBEAM", "CROD": "PROD", "CONROD": ""}
# Fields of a property: area, and non-structural mass per length.
_AREA, _PER_LENGTH = 2, {"PBAR": 6, "PBEAM": 7, "PROD": 5}
_DENSITY = 4  # on MAT1
# Elements and properties without a counted mass: the mass of a deck that has any is unknown.
_OTHERS = (
    *("CQUAD8", "CQUADR", "CQUAD", "CTRIA6", "CTRIAR", "CSHEAR", "CTRIAX", "CTRIAX6", "CQUADX", "PCOMP", "PCOMPG"),
    *("CPYRAM", "CTUBE", "CBEND", "CBEAM3", "CMASS1", "CMASS2", "CMASS3", "CMASS4", "MAT2", "MAT8", "MAT9"),
    *("PBCOMP", "PBRSECT", "PBMSECT", "BAROR", "BEAMOR", "NSM", "NSM1", "NSML", "NSML1", "DMIG"),
)
_SHAPED = {"PBARL": "PBAR", "PBEAML": "PBEAM"}
_PLATES, _SOLIDS = {"CTRIA3": 3, "CQUAD4": 4}, {"CTETRA": 4, "CPENTA": 6, "CHEXA": 8}
_MORE = ("PSHELL", "PSOLID", "MAT1", "CONM1", "CONM2", "PARAM")
# Of the size of an element: corners printed with five digits.
_EVEN = 1e-4
# Of a CONM1: masses printed with seven digits.
_ONE_MASS = 1e-6
_PLAIN_BEAM = 8  # fields of a PBEAM without stations along it
_AT_POINT = -1  # frame of a CONM2 whose offset is a place in basic

_HEXAHEDRON = ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))
# A tetrahedron and a wedge are hexahedra with corners that coincide.
_CORNERS = {4: (0, 1, 2, 2, 3, 3, 3, 3), 6: (0, 1, 2, 2, 3, 4, 5, 5), 8: (0, 1, 2, 3, 4, 5, 6, 7)}
_DIMENSIONS = {"ROD": 1, "TUBE": 2, "BAR": 2, "BOX": 4}

_OTHER = re.compile(rb"^(" + "|".join(_OTHERS).encode() + rb")\b", re.MULTILINE | re.IGNORECASE)
_COUNTED = re.compile(rb"^(CONM1|CONM2|MAT1)\b", re.MULTILINE | re.IGNORECASE)


def deck_mass(path: Path, nodes: Nodes) -> tuple[float, Array] | None:
    """Add up the masses of the elements of a deck.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control.
    nodes : Nodes
        Its grids.

    Returns
    -------
    (float, (3,) float64) or None
        Mass of all bars, rods, plates, solids and point masses, and their centre in basic, in the units of the deck.
        None if the file is no deck, states no mass, or has elements that are not counted: plates in layers or with an
        offset or a thickness of their own, skew plates and solids (their centre depends on the lumping of mass),
        elements with nodes between corners, scalar masses (CMASS has no place), sections with stations or with other
        shapes than BAR, BOX, ROD and TUBE, a CONM1 that is no point mass.
    """
    try:
        # A search of the bytes is fast, also in large decks of solids.
        content = path.read_bytes()
        if not _COUNTED.search(content) or _OTHER.search(content):
            return None
        wanted = {*_BARS, *_BARS.values(), *_SHAPED, *_PLATES, *_SOLIDS, *_OTHERS, *_MORE} - {""}
        sections = read_cards(path, wanted).sections
        cards = sections.get(0, {})
        if len(sections) > 1 or any(cards.get(name) for name in _OTHERS):
            return None
        parts = [*_bars(cards, nodes), *_plates(cards, nodes), *_solids(cards, nodes), *_points(cards, nodes)]
    except (OSError, ReadError, _NotCountedError):
        return None
    masses = np.array([mass for mass, _ in parts])
    if not masses.sum() > 0:
        return None
    centre = masses @ np.array([place for _, place in parts]) / masses.sum()
    # PARAM, WTMASS: factor of weights.
    scale = next((card.real(1) for card in cards.get("PARAM", ()) if card.text(0).upper() == "WTMASS"), 1.0)
    return float(masses.sum()) * scale, centre


class _NotCountedError(Exception):
    """The deck has a mass that is not counted."""


def _bars(cards: Cards, nodes: Nodes) -> Iterator[tuple[float, Array]]:
    density = _densities(cards)
    sections = {}
    for name, kind in _SHAPED.items():
        for card in cards.get(name, ()):
            area, per_length = _section_by_shape(card)
            sections[kind, card.integer(0)] = (card.integer(1), area, per_length)
    for name in filter(None, _BARS.values()):
        for card in cards.get(name, ()):
            if name == "PBEAM" and any(card.text(k) for k in range(_PLAIN_BEAM + 8, len(card.fields))):
                raise _NotCountedError
            sections[name, card.integer(0)] = (card.integer(1), card.real(_AREA), card.real(_PER_LENGTH[name]))
    for name, kind in _BARS.items():
        for card in cards.get(name, ()):
            key, first = (kind, card.integer(1, card.integer(0))), 2
            if name == "CONROD":
                (material, area, per_length), first = (card.integer(3), card.real(4), card.real(7)), 1
            elif key in sections:
                material, area, per_length = sections[key]
            else:
                raise _NotCountedError
            if material not in density:
                raise _NotCountedError
            ends = np.array([_place(nodes, card.integer(first + k)) for k in range(2)])
            if name in ("CBAR", "CBEAM"):
                ends += [nodes.frame[_index(nodes, card.integer(2 + k))].T @ w for k, w in enumerate(offsets_of(card))]
            length = float(np.linalg.norm(ends[1] - ends[0]))
            yield (density[material] * area + per_length) * length, ends.mean(axis=0)


def _points(cards: Cards, nodes: Nodes) -> Iterator[tuple[float, Array]]:
    for card in cards.get("CONM2", ()):
        frame, offset = card.integer(2, 0), np.array([card.real(k) for k in (4, 5, 6)])
        if frame > 0 and offset.any():
            raise _NotCountedError
        place = offset if frame == _AT_POINT else _place(nodes, card.integer(1)) + offset
        yield card.real(3), place
    for card in cards.get("CONM1", ()):
        # EID, G, CID, then the lower triangle M11 M21 M22 M31 .. M66; a point mass is equal in all directions.
        triangle = np.zeros((6, 6))
        triangle[np.tril_indices(6)] = [card.real(3 + k) for k in range(21)]
        mass = float(triangle[0, 0])
        translation, coupling = triangle[:3, :3], triangle[3:, :3]
        if abs(translation - mass * np.eye(3)).max() > _ONE_MASS * abs(mass) or coupling.any():
            raise _NotCountedError
        yield mass, _place(nodes, card.integer(1))


def _densities(cards: Cards) -> dict[int, float]:
    return {card.integer(0): card.real(_DENSITY) for card in cards.get("MAT1", ())}


def _plates(cards: Cards, nodes: Nodes) -> Iterator[tuple[float, Array]]:
    density = _densities(cards)
    made = {card.integer(0): card for card in cards.get("PSHELL", ())}
    for name, count in _PLATES.items():
        for card in cards.get(name, ()):
            property = made.get(card.integer(1, card.integer(0)))
            # After the corners: an angle of the material, then the element's own offset and thicknesses.
            own = any(card.real(k) for k in range(3 + count, len(card.fields)))
            if property is None or own or property.integer(1, 0) not in density:
                raise _NotCountedError
            corners = np.array([_place(nodes, card.integer(2 + k)) for k in range(count)])
            area, centre = _plate_area(corners)
            _refuse_skew(corners, centre)
            yield (density[property.integer(1)] * property.real(2) + property.real(7)) * area, centre


def _solids(cards: Cards, nodes: Nodes) -> Iterator[tuple[float, Array]]:
    density = _densities(cards)
    material = {card.integer(0): card.integer(1) for card in cards.get("PSOLID", ())}
    for name, count in _SOLIDS.items():
        for card in cards.get(name, ()):
            of = material.get(card.integer(1, card.integer(0)))
            if of not in density or any(card.text(k) for k in range(2 + count, len(card.fields))):
                raise _NotCountedError
            corners = np.array([_place(nodes, card.integer(2 + k)) for k in range(count)])
            volume, centre = _solid_volume(corners)
            _refuse_skew(corners, centre)
            yield density[of] * volume, centre


def _refuse_skew(corners: Array, centre: Array) -> None:
    """Refuse an element whose centre is not the mean of its corners: lumped and consistent masses differ there."""
    mean = corners.mean(axis=0)
    if np.linalg.norm(centre - mean) > _EVEN * float(np.linalg.norm(corners - mean, axis=1).max()):
        raise _NotCountedError


def _place(nodes: Nodes, node: int) -> Array:
    return np.asarray(nodes.xyz[_index(nodes, node)])


def _index(nodes: Nodes, node: int) -> int:
    at = int(nodes.index(node)[0])
    if at < 0:
        raise _NotCountedError
    return at


def _section_by_shape(card: Card) -> tuple[float, float]:
    """Area and non-structural mass per length of a PBARL or PBEAML of a simple shape without taper.

    ROD: radius. TUBE: outer and inner radius. BAR: width, height. BOX: width, height, walls above and beside.
    """
    shape = card.text(3)
    count = _DIMENSIONS.get(shape)
    # Fields after the dimensions and the non-structural mass are a second station of a beam.
    if count is None or any(card.text(k) for k in range(8 + count + 1, len(card.fields))):
        raise _NotCountedError
    d = [card.real(8 + k) for k in range(count)]
    areas = {
        "ROD": lambda: np.pi * d[0] ** 2,
        "TUBE": lambda: np.pi * (d[0] ** 2 - d[1] ** 2),
        "BAR": lambda: d[0] * d[1],
        "BOX": lambda: d[0] * d[1] - (d[0] - 2 * d[3]) * (d[1] - 2 * d[2]),
    }
    return float(areas[shape]()), card.real(8 + count)


def _plate_area(corners: Array) -> tuple[float, Array]:
    """Area and centre (3,) of a triangle or a quadrilateral (3 or 4, 3), cut along a diagonal.

    Examples
    --------
    >>> area, centre = _plate_area(np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]))
    >>> area, centre.tolist()
    (2.0, [1.0, 0.5, 0.0])
    """
    triangles = [corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
    areas = np.array([np.linalg.norm(np.cross(t[1] - t[0], t[2] - t[0])) / 2 for t in triangles])
    centres = np.array([t.mean(axis=0) for t in triangles])
    return float(areas.sum()), areas @ centres / max(float(areas.sum()), np.finfo(float).tiny)


def _solid_volume(corners: Array) -> tuple[float, Array]:
    """Volume and centre (3,) of a tetrahedron, wedge or hexahedron with straight edges (4, 6 or 8, 3).

    Two Gauss points each way integrate its trilinear map exactly.
    """
    x, at = corners[list(_CORNERS[len(corners)])], np.array(_HEXAHEDRON, dtype=np.float64)
    volume, moment = 0.0, np.zeros(3)
    for point in itertools.product((-(3**-0.5), 3**-0.5), repeat=3):
        terms = 1 + at * point
        shape = terms.prod(axis=1) / 8
        slope = np.array([at[:, k] * terms[:, (k + 1) % 3] * terms[:, (k + 2) % 3] / 8 for k in range(3)])
        size = float(np.linalg.det(slope @ x))
        volume, moment = volume + size, moment + size * (shape @ x)
    return abs(volume), moment / (volume or 1.0)
