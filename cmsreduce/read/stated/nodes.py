"""Stiffness that the elements of a deck give to single nodes.

A sum over a body hides an error of one part behind the others, and one of a soft part behind the stiff ones. Bars and
springs have one stiffness matrix. Of solids that pass the patch test the forces at their nodes under a uniform strain
are known: the stress times the integral of the slopes of the shape functions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.read.stated.statement import SAME_PLACE, STRAINS, StatedNodes, StatedPlates

__all__ = ["Solids", "flat_plates", "sum_at_nodes", "uniform_forces"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class Solids(NamedTuple):
    """Isotropic solids, whose forces under a uniform strain are known.

    Parameters
    ----------
    nodes : (e, k) int64
        Positions of their nodes.
    slopes : (e, k, 3) float64
        Integrals of the slopes of the shape functions along x, y, z.
    G, lame : (e,) float64
        Lame's constants: the shear modulus and lambda.
    """

    nodes: Indices
    slopes: Array
    G: Array
    lame: Array


def uniform_forces(by_shear: Array, by_lame: Array) -> Array:
    """Forces (..., 3, 6) under the strains of `STRAINS`, from integrals of slopes (..., 3) times G and lambda."""
    force = np.zeros((*by_shear.shape, len(STRAINS)))
    for column, (i, j) in enumerate(STRAINS):
        force[..., i, column] = 2 * by_shear[..., j]
        if i == j:
            force[..., column] += by_lame
        else:
            # An entry of G off the diagonal stands for two.
            force[..., j, column] = 2 * by_shear[..., i]
    return force


def flat_plates(corners: Indices, xyz: Array, laminate: Array, alike: Indices) -> StatedPlates:
    """Plates (e,) by the positions of their corners (e, k), with a laminate (e, 6, 6) about the first edge.

    Triangles have three corners, quadrilaterals four. ``alike`` is the same number for plates of one property.
    """
    x = xyz[corners]
    across = np.cross(x[:, 2] - x[:, 0], x[:, -1] - x[:, 1])
    size, twice = np.ptp(x, axis=1).max(axis=1), np.linalg.norm(across, axis=1)
    n = across / np.maximum(twice, np.finfo(float).tiny)[:, None]
    first = x[:, 1] - x[:, 0]
    first = first - n * np.einsum("ei,ei->e", first, n)[:, None]
    first = first / np.maximum(np.linalg.norm(first, axis=1), np.finfo(float).tiny)[:, None]
    off = abs(np.einsum("eki,ei->ek", x - x.mean(axis=1, keepdims=True), n)).max(axis=1)
    # All corners are convex, or the element has no shape.
    sides = np.roll(x, -1, axis=1) - x
    turns = np.einsum("eki,ei->ek", np.cross(np.roll(sides, 1, axis=1), sides), n)
    flat = (off <= SAME_PLACE * size) & (turns > SAME_PLACE * size[:, None] ** 2).all(axis=1)
    four = np.full((len(x), 4), -1)
    four[:, : corners.shape[1]] = corners
    return StatedPlates(four, np.stack([first, np.cross(n, first), n], axis=1), laminate, flat, alike)


def sum_at_nodes(
    count: int,
    solids: Iterable[Solids],
    stiffness: sp.csr_array | None,
    known: Indices,
    unknown: Indices,
    bars: Indices | None = None,
    plates: StatedPlates | None = None,
) -> StatedNodes | None:
    """Add up the elements at each of ``count`` nodes; None if no node is known.

    ``known`` are nodes of bars and springs with a known stiffness, ``unknown`` those of elements without one, ``bars``
    those of all bars.
    """
    # Forces are linear in the slopes: six sums at each node make all of its eighteen forces.
    sums, terms = np.zeros((6, count)), np.zeros(count)
    solid, sure, barred = (np.zeros(count, dtype=bool) for _ in range(3))
    shapes = []
    for nodes, slopes, G, lame in solids:
        shapes.append(nodes)
        at = nodes.ravel()
        weighted = [weight[:, None] * slopes[:, :, k] for weight in (G, lame) for k in range(3)]
        sums += [np.bincount(at, each.ravel(), count) for each in weighted]
        # Norm of all forces. A corner of a quadratic tetrahedron has none: the largest of each element is the measure.
        size = np.sqrt((3 * lame**2 + 4 * lame * G + 12 * G**2) * np.einsum("eki,eki->ek", slopes, slopes).max(axis=1))
        terms += np.bincount(at, np.repeat(size, nodes.shape[1]), count)
        solid[at] = True
    force = uniform_forces(sums[:3].T, sums[3:].T)
    if bars is not None:
        barred[bars] = True
    sure[known] = True
    sure |= solid
    if plates is not None:
        sure |= plates.touch(np.ones(len(plates.flat), dtype=bool), count)
    sure[unknown] = False
    K = sp.csr_array((6 * count, 6 * count)) if stiffness is None else stiffness
    if not sure.any():
        return None
    return StatedNodes(K, force, terms, sure, solid, barred, plates, solids=tuple(shapes))
