"""Matrices of isoparametric solids by the points of a program's rule, in blocks of two nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.stated.isoparametric import Rule, Solid, quadrature

__all__ = ["SolidEntries", "solid_masses", "solid_stiffness"]

Array = NDArray[np.float64]


class SolidEntries(NamedTuple):
    """Isotropic solids of one kind and material, and the rule of their program.

    Parameters
    ----------
    solid : Solid
        Shape functions.
    rule : Rule
        Points of integration of stiffness and mass.
    nodes : (e, k) int64
        Positions of their nodes.
    G, lame, density : float
        Shear modulus, lambda and density; nan where the deck states none.
    """

    solid: Solid
    rule: Rule
    nodes: NDArray[np.int64]
    G: float
    lame: float
    density: float


def solid_masses(part: SolidEntries, xyz: Array, which: NDArray[np.int64]) -> Array:
    """Masses (e, k, k) of some of the solids between their nodes, the same along x, y and z.

    Examples
    --------
    >>> from cmsreduce.read.stated.isoparametric import RULES, SOLIDS
    >>> cube = SolidEntries(SOLIDS["C3D20"], RULES["C3D20", False], np.arange(20)[None], 1.0, 1.0, 3.0)
    >>> float(solid_masses(cube, SOLIDS["C3D20"].places, np.zeros(1, dtype=np.int64)).sum().round(9))
    24.0
    """
    weights, shapes, slopes = quadrature(part.solid, part.rule)
    x = xyz[part.nodes[which]]
    size = np.stack([abs(np.linalg.det(each @ x)) for each in slopes], axis=1)
    return np.asarray(np.einsum("q,eq,qa,qb->eab", part.density * weights, size, shapes, shapes, optimize=True))


def solid_stiffness(part: SolidEntries, xyz: Array, which: NDArray[np.int64]) -> Array:
    """Stiffness (e, k, 3, k, 3) of some of the solids.

    Examples
    --------
    >>> from cmsreduce.read.stated.isoparametric import RULES, SOLIDS
    >>> cube = SolidEntries(SOLIDS["C3D20"], RULES["C3D20", False], np.arange(20)[None], 1.0, 1.0, 3.0)
    >>> K = solid_stiffness(cube, SOLIDS["C3D20"].places, np.zeros(1, dtype=np.int64)).reshape(60, 60)
    >>> int(np.linalg.matrix_rank(K))
    54
    """
    weights, _, slopes = quadrature(part.solid, part.rule)
    x = xyz[part.nodes[which]]
    k = x.shape[1]
    found = np.zeros((len(x), k, 3, k, 3))
    for weight, each in zip(weights, slopes, strict=True):
        J = each @ x
        size = weight * abs(np.linalg.det(J))
        slope = np.linalg.solve(J, np.broadcast_to(each, (len(x), *each.shape)))
        along = np.einsum("e,eia,ejb->eaibj", size, slope, slope)
        found += part.lame * along + part.G * along.transpose(0, 1, 4, 3, 2)
        across = part.G * np.einsum("eaibi->eab", along)
        for i in range(3):
            found[:, :, i, :, i] += across
    return found
