"""Flat faces of bodies that lie against each other, where their meshes have no node in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.pipeline.drafts.proposed_interfaces import Place

__all__ = ["facing_places"]

Array = NDArray[np.float64]

# Nodes off their plane, or planes from each other, relative to the radius of a face; the cosine between two planes; the
# distance of two centres, relative to the smaller radius: a mesh that is finer on one side moves the mean of its nodes.
_FLAT, _PARALLEL, _NEAR = 1e-3, 0.9999, 0.25


class _Face(NamedTuple):
    """Centre (3,), radius and normal (3,) out of the body, in metres."""

    centre: Array
    radius: float
    normal: Array


def facing_places(
    bodies: Mapping[str, FEModel],
    places: Mapping[str, Sequence[Place]],
    lengths: Mapping[str, float],
) -> dict[tuple[str, str], tuple[Place, Place]]:
    """Find faces at which bodies meet.

    Parameters
    ----------
    bodies : mapping of name to FEModel
        Bodies with geometry, as their files have them.
    places : mapping of name to sequence of Place
        Places where each body could be joined.
    lengths : mapping of name to float
        Metres in the unit of length of each body.

    Returns
    -------
    mapping of (str, str) to (Place, Place)
        Of two bodies, in their order, the nearest faces, tied to one point between the centres of both.
    """
    faces = {
        name: [(place, face) for place in places.get(name, ()) if (face := _face(body, place, lengths[name]))]
        for name, body in bodies.items()
    }
    pairs = {}
    for one, other in combinations(bodies, 2):
        found: list[tuple[float, int, Place, Place, Array]] = []
        for (mine, a), (theirs, b) in product(faces[one], faces[other]):
            apart, radius = a.centre - b.centre, min(a.radius, b.radius)
            gap, touching = float(np.linalg.norm(apart)), abs(apart @ a.normal) <= _FLAT * radius
            if touching and a.normal @ b.normal < -_PARALLEL and gap <= _NEAR * radius:
                found.append((gap, len(found), mine, theirs, (a.centre + b.centre) / 2))
        if found:
            gap, _, mine, theirs, point = min(found, key=lambda each: each[:2])
            pairs[one, other] = (
                _tied_at(mine, other, theirs, point / lengths[one], gap),
                _tied_at(theirs, one, mine, point / lengths[other], gap),
            )
    return pairs


def _face(body: FEModel, place: Place, length: float) -> _Face | None:
    """The flat face of a place with a tie; None for any other."""
    assert body.nodes is not None
    if not place.tied:
        return None
    xyz = length * body.nodes.xyz[body.nodes.index(place.nodes)]
    centre = xyz.mean(axis=0)
    radius = float(np.sqrt(np.square(xyz - centre).sum(axis=1).mean()))
    normal = np.linalg.svd(xyz - centre, full_matrices=False)[2][-1]
    if len(xyz) < 3 or abs((xyz - centre) @ normal).max() > _FLAT * radius:
        return None
    inside = length * body.nodes.xyz.mean(axis=0) - centre
    return _Face(centre, radius, -normal if normal @ inside > 0 else normal)


def _tied_at(place: Place, other: str, theirs: Place, point: Array, gap: float) -> Place:
    """The place tied to a point in its body's unit of length."""
    size = float(abs(point).max()) or 1.0
    at = ", ".join(f"{x:.9g}" for x in size * np.round(point / size, 9) + 0.0)
    words = f"{place.words}; against {theirs.name} of {other}, {gap:.3g} m from its centre; the tie stiffens it"
    return replace(
        place, name=f"to_{other}", interface=f"{place.interface.removesuffix('}')}, position: [{at}]}}", words=words
    )
