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

from cmsreduce.read.stated import STRAINS, StatedNodes

__all__ = ["SolidForces", "solid_forces", "sum_at_nodes"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class SolidForces(NamedTuple):
    """Forces of some solids at their nodes: positions (e, k) and forces (e, k, 3, 6)."""

    nodes: Indices
    force: Array


def solid_forces(nodes: Indices, slopes: Array, G: Array, lame: Array) -> SolidForces:
    """Forces of isotropic solids with Lame's constants (e,), from the integrals of their slopes (e, k, 3)."""
    stress = np.zeros((len(G), 3, 3, len(STRAINS)))
    for column, (i, j) in enumerate(STRAINS):
        if i == j:
            stress[:, range(3), range(3), column] += lame[:, None]
            stress[:, i, i, column] += 2 * G
        else:
            # An entry of G off the diagonal stands for two.
            stress[:, i, j, column] = stress[:, j, i, column] = 2 * G
    return SolidForces(nodes, np.einsum("eijs,ekj->ekis", stress, slopes))


def sum_at_nodes(
    count: int, solids: Iterable[SolidForces], stiffness: sp.csr_array | None, barred: Indices, unknown: Indices
) -> StatedNodes | None:
    """Add up the elements at each of ``count`` nodes; None if no node is known.

    ``barred`` are nodes of bars and springs with a known stiffness, ``unknown`` those of other elements.
    """
    force, terms = np.zeros((count, 3, len(STRAINS))), np.zeros(count)
    solid, known = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for each in solids:
        np.add.at(force, each.nodes, each.force)
        # A corner of a quadratic tetrahedron has no force: the largest of each element is the measure.
        size = np.linalg.norm(each.force, axis=(2, 3)).max(axis=1, keepdims=True)
        np.add.at(terms, each.nodes, np.broadcast_to(size, each.nodes.shape))
        solid[each.nodes] = True
    known[barred] = True
    known |= solid
    known[unknown] = False
    K = sp.csr_array((6 * count, 6 * count)) if stiffness is None else stiffness
    return StatedNodes(K, force, terms, known, solid) if known.any() else None
