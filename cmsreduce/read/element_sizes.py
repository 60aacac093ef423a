"""Sizes of elements by their corners and sections: areas of cross-sections and plates, volumes of solids."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.cards import Card

__all__ = ["plate_area", "section_area", "section_extra", "solid_volume"]

Array = NDArray[np.float64]

_HEXAHEDRON = ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))
# A tetrahedron and a wedge are hexahedra some of whose corners coincide.
_CORNERS = {4: (0, 1, 2, 2, 3, 3, 3, 3), 6: (0, 1, 2, 2, 3, 4, 5, 5), 8: (0, 1, 2, 3, 4, 5, 6, 7)}
_DIMENSIONS = {"ROD": 1, "TUBE": 2, "BAR": 2, "BOX": 4}


def section_area(card: Card) -> float | None:
    """Area of a PBARL or PBEAML section of one of the simple shapes; None of others, and of tapered beams.

    ROD: radius. TUBE: outer and inner radius. BAR: width, height. BOX: width, height, walls above and beside.
    """
    shape = card.text(3)
    count = _DIMENSIONS.get(shape)
    # What follows the dimensions and the mass that is no structure is a second station of a beam.
    if count is None or any(card.text(k) for k in range(8 + count + 1, len(card.fields))):
        return None
    d = [card.real(8 + k) for k in range(count)]
    areas = {
        "ROD": lambda: np.pi * d[0] ** 2,
        "TUBE": lambda: np.pi * (d[0] ** 2 - d[1] ** 2),
        "BAR": lambda: d[0] * d[1],
        "BOX": lambda: d[0] * d[1] - (d[0] - 2 * d[3]) * (d[1] - 2 * d[2]),
    }
    return float(areas[shape]())


def section_extra(card: Card) -> float:
    """Mass per length of a PBARL or PBEAML section that is no structure."""
    return card.real(8 + _DIMENSIONS[card.text(3)])


def plate_area(corners: Array) -> tuple[float, Array]:
    """Area and centre (3,) of a triangle or a quadrilateral (3 or 4, 3), cut along a diagonal.

    Examples
    --------
    >>> area, centre = plate_area(np.array([[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]))
    >>> area, centre.tolist()
    (2.0, [1.0, 0.5, 0.0])
    """
    triangles = [corners[[0, k, k + 1]] for k in range(1, len(corners) - 1)]
    areas = np.array([np.linalg.norm(np.cross(t[1] - t[0], t[2] - t[0])) / 2 for t in triangles])
    centres = np.array([t.mean(axis=0) for t in triangles])
    return float(areas.sum()), areas @ centres / max(float(areas.sum()), np.finfo(float).tiny)


def solid_volume(corners: Array) -> tuple[float, Array]:
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
