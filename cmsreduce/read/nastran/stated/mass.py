"""Mass, centre, inertia and masses of the nodes that a NASTRAN deck states."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.cards import Cards
from cmsreduce.read.nastran.stated.elements import LAYERED, UNCOUNTED, Elements, node_index, stated_elements
from cmsreduce.read.nastran.stated.faces import EDGES, Faces
from cmsreduce.read.nastran.stated.materials import Material
from cmsreduce.read.nastran.stated.points import even_inertia, offset_of, point_blocks, turning_mass, uneven_masses
from cmsreduce.read.stated import (
    MassPart,
    NotCountedError,
    StatedMass,
    are_curved,
    as_inertia,
    outer,
    point_mass,
    sum_of_masses,
)

__all__ = ["grid_masses", "mass_of", "solid_volumes"]

Array = NDArray[np.float64]

# The mass of a deck that has any of these is unknown.
_OTHERS = (*UNCOUNTED, *LAYERED, "CMASS3", "CMASS4", "NSM", "NSM1", "NSML", "NSML1")
# Of the size of an element: corners printed with five digits.
_EVEN = 1e-4
# Of the size of an element: what the edges of a parallelepiped differ by. The error of two points is its square.
_PARALLEL = 1e-6

_HEXAHEDRON = ((-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1))
# Triangles of three corners of a quadrilateral.
_AROUND = ((0, 1, 2), (1, 2, 3), (2, 3, 0), (3, 0, 1))
# A tetrahedron, a pyramid and a wedge are hexahedra with corners that coincide.
_PYRAMID = 5
_CORNERS = {
    4: (0, 1, 2, 2, 3, 3, 3, 3),
    5: (0, 1, 2, 3, 4, 4, 4, 4),
    6: (0, 1, 2, 2, 3, 4, 5, 5),
    8: (0, 1, 2, 3, 4, 5, 6, 7),
}


def mass_of(elements: Elements | None) -> StatedMass | None:
    """Add up the masses of the elements of a deck.

    Returns
    -------
    StatedMass or None
        None if the file is no deck, states no mass, or has elements that are not counted: plates in layers or with an
        offset or a thickness that differs between corners, skew plates and solids (their centre depends on the lumping
        of mass), elements with curved edges, scalar masses beside those at one grid, tapered sections or ones of other
        shapes than BAR, BOX, ROD and TUBE, pyramids.
    """
    if elements is None or any(elements.cards.get(name) for name in _OTHERS):
        return None
    cards, nodes = elements.cards, elements.nodes
    try:
        parts = [*_bars(elements), *_plates(elements), *_solids(elements), *_points(elements)]
        uneven = uneven_masses(elements)
    except (ReadError, NotCountedError):
        return None
    scale = _weight_factor(cards)
    stated = sum_of_masses(parts, len(nodes), scale)
    if stated is None:
        return None
    points, unknown = point_blocks(elements)
    turning = scale * turning_mass(elements)
    turning[unknown] = np.inf
    # Between corners each program has shares of its own.
    known = not any(faces.between.shape[1] for faces in (*elements.solids, *elements.plates))
    uneven = None if uneven is None else scale * uneven
    return stated._replace(points=scale * points, turning=turning, uneven=uneven, nodal_known=known)


def grid_masses(path: Path, nodes: Nodes) -> Array | None:
    """Mass matrix (N, 6, 6) of each grid of a deck whose masses are lumped, along basic axes.

    Parameters
    ----------
    path : Path
        Deck.
    nodes : Nodes
        Its N grids.

    Returns
    -------
    (N, 6, 6) float64 or None
        Masses of elements, and masses, offsets and inertias of CONM2; None where `mass_of` gives none, elements have
        nodes between corners, or a CONM1 has an inertia.
    """
    elements = stated_elements(path, nodes)
    stated = mass_of(elements)
    if elements is None or stated is None or stated.uneven is not None or not stated.nodal_known:
        return None
    cards = elements.cards
    scale = _weight_factor(cards)
    found, unknown = point_blocks(elements)
    if unknown.any():
        return None
    found *= scale
    found[:, range(3), range(3)] = stated.nodal[:, None]
    return found


def _weight_factor(cards: Cards) -> float:
    """PARAM, WTMASS: factor of weights."""
    return next((card.real(1) for card in cards.get("PARAM", ()) if card.text(0).upper() == "WTMASS"), 1.0)


def _density(number: int, materials: dict[int, Material]) -> float:
    if number not in materials or np.isnan(materials[number].density):
        raise NotCountedError
    return materials[number].density


def _bars(elements: Elements) -> Iterator[MassPart]:
    bars, materials = elements.bars, elements.materials
    if elements.loose_bars.size:
        raise NotCountedError
    if not bars:
        return
    ends = np.array([bar.ends for bar in bars])
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    density = np.array([_density(bar.section.material, materials) for bar in bars])
    per_length = density * [bar.section.area for bar in bars] + [bar.section.per_length for bar in bars]
    mass, centre = per_length * length, ends.mean(axis=1)
    # Halves at the ends have three times the moment of a straight line.
    twist = density * length * [np.trace(bar.section.moments) for bar in bars]
    lumped = as_inertia(outer(along) * (mass / 6)[:, None, None]) + twist[:, None, None]
    spread = mass[:, None, None] * (outer(centre) + outer(along) / 12)
    # The halves are at the grids, offsets or not.
    yield np.array([bar.nodes for bar in bars]), np.repeat(mass[:, None] / 2, 2, axis=1), centre, spread, lumped


def _points(elements: Elements) -> Iterator[MassPart]:
    cards, nodes = elements.cards, elements.nodes
    for card in cards.get("CONM2", ()):
        at = node_index(nodes, card.integer(1))
        place = nodes.xyz[at] + offset_of(card, elements)[0]
        # Moments are along the card's frame; their size bounds their share in every frame.
        own = np.zeros((3, 3))
        own[np.tril_indices(3)] = [card.real(k) for k in range(8, 14)]
        yield point_mass(at, card.real(3), place, float(abs(own).sum()))
    for card in cards.get("CONM1", ()):
        # Masses that differ by direction are stated apart.
        if (inertia := even_inertia(card)) is not None:
            at = node_index(nodes, card.integer(1))
            yield point_mass(at, card.real(3), nodes.xyz[at], inertia)


def _plates(elements: Elements) -> Iterator[MassPart]:
    for faces in elements.plates:
        per_area = faces.each(lambda p: _density(p.integer(1, 0), elements.materials))
        per_area = per_area * faces.thick + faces.each(lambda p: p.real(7))
        corners = elements.nodes.xyz[faces.nodes]
        area, centre, second = _plate_areas(corners)
        yield _spread(
            faces,
            corners,
            per_area,
            area,
            centre,
            second,
            _plate_shares(corners, area),
            elements.nodes.xyz[faces.between],
        )


def _solids(elements: Elements) -> Iterator[MassPart]:
    for faces in elements.solids:
        # The shape functions of a pyramid differ between programs.
        if faces.corners == _PYRAMID:
            raise NotCountedError
        density = faces.each(lambda p: _density(p.integer(1), elements.materials))
        corners, between = elements.nodes.xyz[faces.nodes], elements.nodes.xyz[faces.between]
        if are_curved(corners, between, np.array(EDGES[faces.corners])).any():
            raise NotCountedError
        volume, centre, second = solid_volumes(corners)
        yield _spread(faces, corners, density, volume, centre, second, between=between)


def _spread(
    faces: Faces,
    corners: Array,
    density: Array,
    size: Array,
    centre: Array,
    second: Array,
    shares: Array | None = None,
    between: Array | None = None,
) -> MassPart:
    """Elements whose nodes have nearly equal shares (e, k) of the mass; skew ones are refused.

    Those of nodes between corners (e, m, 3) differ by program: the mass of an element at its farthest node is the most
    that they change.
    """
    # Elements last: every step is one pass over long rows.
    x = np.ascontiguousarray(corners.transpose(1, 2, 0))
    mean = x.mean(axis=0)
    reach = np.sqrt(np.einsum("kie,kie->ke", x - mean, x - mean).max(axis=0))
    if (np.linalg.norm(centre.T - mean, axis=0) > _EVEN * reach).any():
        raise NotCountedError
    mass = density * size
    spread = density[:, None, None] * second
    if between is not None and between.shape[1]:
        nodes = np.hstack([faces.nodes, faces.between])
        most = (mass * reach**2)[:, None, None] * np.ones((3, 3))
        return nodes, np.repeat(mass[:, None] / nodes.shape[1], nodes.shape[1], axis=1), centre, spread, most
    share = mass[:, None] * (np.full(corners.shape[:2], 1 / faces.corners) if shares is None else shares)
    lumped = (share[:, :, None] * corners).transpose(0, 2, 1) @ corners
    return faces.nodes, share, centre, spread, as_inertia(lumped - spread)


def _plate_shares(corners: Array, area: Array) -> Array:
    """Shares (e, k) of the corners of flat plates in their mass: the mean of the shape functions over the area."""
    if corners.shape[1] != len(_AROUND):
        return np.full(corners.shape[:2], 1 / corners.shape[1])
    # A corner gets a third of each triangle of three corners; both pairs of triangles make up the quadrilateral.
    shares = np.zeros(corners.shape[:2])
    for triangle in _AROUND:
        a, b, c = (corners[:, k] for k in triangle)
        part = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        shares[:, list(triangle)] += (part / 6)[:, None]
    return np.asarray(shares / np.maximum(area, np.finfo(float).tiny)[:, None])


def _plate_areas(corners: Array) -> tuple[Array, Array, Array]:
    """Areas (e,), centres (e, 3) and second moments (e, 3, 3) of flat triangles or quadrilaterals (e, 3 or 4, 3).

    Examples
    --------
    >>> area, centre, second = _plate_areas(np.array([[[0.0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0]]]))
    >>> area.tolist(), centre.tolist(), second[0].diagonal().tolist()
    ([2.0], [[1.0, 0.5, 0.0]], [2.6666666666666665, 0.6666666666666666, 0.0])
    """
    area, moment, second = 0.0, 0.0, 0.0
    for k in range(1, corners.shape[1] - 1):
        t = corners[:, [0, k, k + 1]]
        part = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1) / 2
        middle = t.mean(axis=1)
        area, moment = area + part, moment + part[:, None] * middle
        # Of a triangle: a twelfth of its corners, and three quarters of its centre.
        second = second + part[:, None, None] * (np.einsum("eki,ekj->eij", t, t) / 12 + 0.75 * outer(middle))
    return np.asarray(area), np.asarray(moment / np.maximum(area, np.finfo(float).tiny)[:, None]), np.asarray(second)


def solid_volumes(corners: Array, *, whole: bool = True) -> tuple[Array, Array, Array]:
    """Volumes (e,), centres (e, 3) and second moments (e, 3, 3) of solids with straight edges (e, 4, 5, 6 or 8, 3).

    Two Gauss points each way integrate the volume and the centre of a trilinear map exactly, and the second moment of
    a parallelepiped; three are exact for a tetrahedron and a wedge. Where the volumes alone are asked for, not
    ``whole``, one fewer will do.
    """
    points = 2 + whole - _are_parallelepipeds(corners)
    # Axes first, elements last: every step is one pass over long rows.
    x = np.ascontiguousarray(corners[:, list(_CORNERS[corners.shape[1]])].transpose(2, 1, 0))
    at, (places, weights) = np.array(_HEXAHEDRON, dtype=np.float64), np.polynomial.legendre.leggauss(points)
    volume, moment, second = np.zeros(x.shape[2]), np.zeros((3, x.shape[2])), np.zeros((3, 3, x.shape[2]))
    for ijk in itertools.product(range(points), repeat=3):
        terms = 1 + at * places[list(ijk)]
        slope = np.array([at[:, k] * terms[:, (k + 1) % 3] * terms[:, (k + 2) % 3] / 8 for k in range(3)])
        # The map's Jacobian by rows, and the place of the point.
        a, b, c, here = np.moveaxis(np.vstack([slope, terms.prod(axis=1) / 8]) @ x, 1, 0)
        size = sum(a[k] * (b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2]) for k in range(3)) * weights[list(ijk)].prod()
        first = size * here
        volume += size
        moment += first
        for k in range(3):
            second[k, k:] += first[k] * here[k:]
    for k in range(3):
        second[k:, k] = second[k, k:]
    sign = np.where(volume < 0, -1.0, 1.0)
    safe = np.where(volume == 0, 1.0, volume)
    return abs(volume), (moment / safe).T, (second * sign).transpose(2, 0, 1)


def _are_parallelepipeds(corners: Array) -> bool:
    """True if the edges (e, 8, 3) of all hexahedra come in four equal ones each way."""
    if corners.shape[1] != len(_HEXAHEDRON):
        return False
    x = corners.transpose(1, 2, 0)
    along, across, size = x[1] - x[0], x[3] - x[0], abs(x[6] - x[0]).max(axis=0)
    others = ((x[2] - x[3], along), (x[5] - x[4], along), (x[6] - x[7], along), (x[7] - x[4], across))
    return all(bool((abs(one - other) <= _PARALLEL * size).all()) for one, other in others)
