"""Integrals over isoparametric solids with straight or curved edges, named as in CalculiX and Abaqus."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "LINEAR_RULES",
    "RULES",
    "SOLIDS",
    "Integrals",
    "Rule",
    "Solid",
    "affine_slope_integrals",
    "are_affine",
    "integrals",
    "quadrature",
    "slope_integrals",
]

Array = NDArray[np.float64]
Powers = tuple[tuple[int, int, int], ...]


class Solid(NamedTuple):
    """Solid of one shape and order.

    Parameters
    ----------
    places : (k, 3) float64
        Its nodes in the reference element, in order of the programs.
    powers : (k, 3) int64
        Powers of the monomials that its shape functions combine.
    edges : (m, 2) int64
        Corners of each edge; its middle node comes in the same order after the corners.
    collapsed : int
        Directions in which the cube of the quadrature collapses: 2 for a tetrahedron, 1 for a wedge.
    """

    places: Array
    powers: NDArray[np.int64]
    edges: NDArray[np.int64]
    collapsed: int

    @property
    def corners(self) -> int:
        """Number of corners."""
        return int(self.edges.max()) + 1


class Rule(NamedTuple):
    """Points (q, 3) of a quadrature over the reference element, and their weights (q,)."""

    at: Array
    weights: Array


class Integrals(NamedTuple):
    """Integrals over some elements.

    Parameters
    ----------
    volume : (e,) float64
        Volumes.
    shares : (e, k) float64
        Of the shape function of each node.
    centre : (e, 3) float64
        Centres.
    second : (e, 3, 3) float64
        Second moments, int x x dV.
    """

    volume: Array
    shares: Array
    centre: Array
    second: Array


def _solid(
    corners: Sequence[tuple[int, int, int]], edges: Sequence[tuple[int, int]], powers: Powers, collapsed: int
) -> Solid:
    at = np.array(corners, dtype=np.float64)
    ends = np.array(edges)
    places = at if len(powers) == len(at) else np.vstack([at, at[ends].mean(axis=1)])
    return Solid(places, np.array(powers), ends, collapsed)


_TETRAHEDRON = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
_WEDGE = [(0, 0, -1), (1, 0, -1), (0, 1, -1), (0, 0, 1), (1, 0, 1), (0, 1, 1)]
_CUBE = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
_TETRAHEDRON_EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
_WEDGE_EDGES = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
_CUBE_EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
_ALL: Powers = tuple((i, j, k) for i, j, k in itertools.product(range(3), repeat=3))
# Monomials of an element of corners, and of serendipity: quadratic along the edges.
_OF_CUBE = tuple(p for p in _ALL if max(p) <= 1), tuple(p for p in _ALL if sorted(p)[1] <= 1)
_OF_WEDGE = (
    tuple(p for p in _ALL if p[0] + p[1] <= 1 and p[2] <= 1),
    tuple(p for p in _ALL if p[0] + p[1] <= 2 and (p[2] <= 1 or p[0] + p[1] <= 1)),
)
_OF_TETRAHEDRON = tuple(p for p in _ALL if sum(p) <= 1), tuple(p for p in _ALL if sum(p) <= 2)

SOLIDS = {
    "C3D4": _solid(_TETRAHEDRON, _TETRAHEDRON_EDGES, _OF_TETRAHEDRON[0], 2),
    "C3D10": _solid(_TETRAHEDRON, _TETRAHEDRON_EDGES, _OF_TETRAHEDRON[1], 2),
    "C3D6": _solid(_WEDGE, _WEDGE_EDGES, _OF_WEDGE[0], 1),
    "C3D15": _solid(_WEDGE, _WEDGE_EDGES, _OF_WEDGE[1], 1),
    "C3D8": _solid(_CUBE, _CUBE_EDGES, _OF_CUBE[0], 0),
    "C3D20": _solid(_CUBE, _CUBE_EDGES, _OF_CUBE[1], 0),
}
"""Solids by the start of the name of the element."""


def _gauss(solid: Solid, points: int) -> Rule:
    """So many Gauss points each way."""
    at, weight = np.polynomial.legendre.leggauss(points)
    grid = np.array(list(itertools.product(at, repeat=3)))
    weights = np.prod(list(itertools.product(weight, repeat=3)), axis=1)
    if solid.collapsed:
        # The square shrinks to a triangle, and the prism to a tetrahedron (Duffy's map).
        unit = (1 + grid) / 2
        y, z = unit[:, 1], unit[:, 2] if solid.collapsed == 2 else np.zeros(len(unit))
        grid = np.stack(
            [unit[:, 0] * (1 - y) * (1 - z), y * (1 - z), z if solid.collapsed == 2 else grid[:, 2]], axis=1
        )
        weights = weights * (1 - y) * (1 - z) ** 2 / (8 if solid.collapsed == 2 else 4)
    return Rule(grid, weights)


def _of_programs() -> dict[tuple[str, bool], Rule]:
    """Rules of second order for a tetrahedron and a triangle, the latter times three Gauss points; and of cubes."""
    near, far = (5 - np.sqrt(5)) / 20, (5 + 3 * np.sqrt(5)) / 20
    tetrahedron = Rule(np.vstack([np.full(3, near), near + (far - near) * np.eye(3)]), np.full(4, 1 / 24))
    z, weight = np.polynomial.legendre.leggauss(3)
    triangle = np.array([[1, 1], [4, 1], [1, 4]]) / 6
    wedge = Rule(np.column_stack([np.repeat(triangle, 3, axis=0), np.tile(z, 3)]), np.tile(weight / 6, 3))
    cube = SOLIDS["C3D20"]
    return {
        ("C3D10", False): tetrahedron,
        ("C3D15", False): wedge,
        ("C3D20", False): _gauss(cube, 3),
        ("C3D20", True): _gauss(cube, 2),
    }


RULES = _of_programs()
"""Points at which CalculiX and Abaqus integrate the stiffness of quadratic solids, by kind, and whether reduced.

Under uniform strain an isoparametric element of any shape has the stress of the strain at all of its points, so that
these rules give its forces and its energy to the last digit.
"""


LINEAR_RULES = {
    ("C3D4", False): Rule(np.full((1, 3), 0.25), np.full(1, 1 / 6)),
    ("C3D6", False): Rule(np.array([[1, 1, z] for z in (-np.sqrt(3), np.sqrt(3))]) / 3, np.full(2, 0.5)),
    ("C3D8", False): _gauss(SOLIDS["C3D8"], 2),
}
"""Points by which CalculiX integrates both matrices of solids of corners, also of those with internal dofs (C3D8I)."""


def integrals(solid: Solid, nodes: Array, points: int | Rule) -> Integrals:
    """Integrate over solids (e, k, 3) by a rule, or with a number of Gauss points each way.

    Three points are exact for the second moments of straight elements.

    Examples
    --------
    >>> cube = SOLIDS["C3D20"]
    >>> found = integrals(cube, cube.places[None] * [1.0, 1.0, 2.0], 3)
    >>> np.round(found.volume, 9).tolist(), np.round(found.shares[0, [0, 8]], 9).tolist()
    ([16.0], [-2.0, 2.666666667])
    """
    x = np.ascontiguousarray(nodes.transpose(2, 1, 0))
    volume, moment = np.zeros(x.shape[2]), np.zeros((3, x.shape[2]))
    shares, second = np.zeros((x.shape[1], x.shape[2])), np.zeros((3, 3, x.shape[2]))
    for weight, shape, slopes in zip(*quadrature(solid, points), strict=True):
        here, (a, b, c) = shape @ x, np.moveaxis(slopes @ x, 1, 0)
        size = weight * sum(a[k] * (b[k - 2] * c[k - 1] - b[k - 1] * c[k - 2]) for k in range(3))
        volume += size
        shares += shape[:, None] * size
        moment += size * here
        second += size * here[:, None] * here
    # Corners in the other order give a negative volume.
    sign = np.where(volume < 0, -1.0, 1.0)
    safe = np.where(volume == 0, 1.0, volume)
    return Integrals(abs(volume), (shares * sign).T, (moment / safe).T, (second * sign).transpose(2, 0, 1))


def slope_integrals(solid: Solid, nodes: Array, points: int | Rule) -> Array:
    """Integrals (e, k, 3) of the slopes of the shape functions along x, y, z, over solids (e, k, 3).

    Two Gauss points each way are exact for parallel edges, three for straight ones.

    Examples
    --------
    >>> cube = SOLIDS["C3D8"]
    >>> slope_integrals(cube, cube.places[None] * [1.0, 1.0, 2.0], 2)[0, 0].round(9).tolist()
    [-2.0, -2.0, -1.0]
    """
    found = np.zeros(nodes.shape)
    volume = np.zeros(len(nodes))
    for weight, _, slopes in zip(*quadrature(solid, points), strict=True):
        a, b, c = np.moveaxis(slopes @ nodes, 1, 0)
        # Rows of the adjugate: the inverse of the map's Jacobian times its determinant.
        adjugate = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
        found += weight * (adjugate @ slopes).transpose(0, 2, 1)
        volume += weight * np.einsum("ei,ei->e", a, np.cross(b, c))
    return np.asarray(found * np.where(volume < 0, -1.0, 1.0)[:, None, None])


def affine_slope_integrals(solid: Solid, nodes: Array) -> Array:
    """Integrals of `slope_integrals` over solids (e, k, 3) of which `are_affine` holds: the map has one Jacobian.

    Examples
    --------
    >>> cube = SOLIDS["C3D20"]
    >>> bool(np.allclose(affine_slope_integrals(cube, cube.places[None]), slope_integrals(cube, cube.places[None], 2)))
    True
    """
    weights, _, slopes = quadrature(solid, 2)
    whole = np.einsum("q,qik->ik", weights, slopes)
    a, b, c = np.moveaxis((whole / weights.sum()) @ nodes, 1, 0)
    adjugate = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
    sign = np.where(np.einsum("ei,ei->e", a, adjugate[:, :, 0]) < 0, -1.0, 1.0)
    return np.asarray((adjugate * sign[:, None, None] @ whole).transpose(0, 2, 1))


def are_affine(solid: Solid, nodes: Array, tolerance: float) -> NDArray[np.bool_]:
    """True for solids (e, k, 3) whose nodes are an affine map of those of the reference element.

    ``tolerance`` is the distance of places that are the same, relative to the size of each element.
    """
    basis = np.hstack([np.ones((len(solid.places), 1)), solid.places])
    # Elements last: every step is one pass over long rows.
    x = np.ascontiguousarray(nodes.transpose(1, 2, 0))
    off = x - np.tensordot(basis @ np.linalg.pinv(basis), x, 1)
    size = np.ptp(x, axis=0).max(axis=0)
    return np.asarray((np.einsum("kie,kie->ke", off, off) <= (tolerance * size) ** 2).all(axis=0))


def quadrature(solid: Solid, points: int | Rule) -> tuple[Array, Array, Array]:
    """Weights (q,), shape functions (q, k) and their slopes (q, 3, k) at the points of a rule."""
    grid, weights = points if isinstance(points, Rule) else _gauss(solid, points)
    inverse = np.linalg.inv(_monomials(solid.powers, solid.places))
    slopes = []
    for axis in range(3):
        lowered = solid.powers.copy()
        lowered[:, axis] = np.maximum(lowered[:, axis] - 1, 0)
        slopes.append((solid.powers[:, axis] * _monomials(lowered, grid)) @ inverse)
    return weights, _monomials(solid.powers, grid) @ inverse, np.stack(slopes, axis=1)


def _monomials(powers: NDArray[np.int64], at: Array) -> Array:
    return np.asarray(np.prod(at[:, None, :] ** powers, axis=2))
