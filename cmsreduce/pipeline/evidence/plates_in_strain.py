"""Flat plates on solids under uniform strains: turns of their nodes, and forces that add to those of the solids.

A plate whose nodes turn with its plane has no shear across it. It is only stretched, by the strain in its plane.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.pipeline.evidence.plate_fields import plates_in_one_plane
from cmsreduce.read import STRAINS, StatedPlates

__all__ = ["PlatesInStrain", "plates_in_strain"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


class PlatesInStrain(NamedTuple):
    """Plates under the uniform strains of `STRAINS`.

    Parameters
    ----------
    turn : (N, 3, 6) float64
        Rotations of the nodes along basic axes; zero at nodes whose plates are not in one plane.
    force : (N, 3, 6) float64
        Forces of the plates at their nodes.
    terms : (N,) float64
        Sum of the largest forces of the plates at each node.
    reach : (N,) float64
        Length of the shortest edge at each node; infinite without plates.
    sure : (N,) bool
        True for nodes whose plates have known turns at all corners.
    """

    turn: Array
    force: Array
    terms: Array
    reach: Array
    sure: Flags


def plates_in_strain(body: FEModel, plates: StatedPlates, rows: Indices) -> PlatesInStrain:
    """Turns and forces of all plates; ``rows`` are the rows of the matrices at nodes."""
    assert body.nodes is not None
    xyz, count = body.nodes.xyz, len(body.nodes)
    at, normal = plates_in_one_plane(body, plates, rows)
    G = np.zeros((len(STRAINS), 3, 3))
    for k, (i, j) in enumerate(STRAINS):
        G[k, i, j] = G[k, j, i] = 1.0
    turn = np.zeros((count, 3, len(STRAINS)))
    # The slope across the plane is G n.
    turn[at] = -np.cross(normal[:, None], np.einsum("kij,nj->nki", G, normal)).transpose(0, 2, 1)
    known = np.zeros(count, dtype=bool)
    known[at] = True
    lost = ~plates.flat | np.any((plates.corners >= 0) & ~known[plates.corners], axis=1)
    force, terms, reach = np.zeros_like(turn), np.zeros(count), np.full(count, np.inf)
    for sides in (3, 4):
        own = np.flatnonzero((plates.corners >= 0).sum(axis=1) == sides)
        corners, plane = plates.corners[own, :sides], plates.axes[own, :2]
        k = np.einsum("eai,kij,ebj->ekab", plane, G, plane)
        strain = np.stack([k[:, :, 0, 0], k[:, :, 1, 1], 2 * k[:, :, 0, 1]], axis=1)
        xx, yy, xy = np.moveaxis(plates.laminate[own, :3, :3] @ strain, 1, 0)
        x = np.einsum("eai,eki->eka", plane, xyz[corners])
        # Half of the force of both edges at a corner: that of the line between their other ends.
        across = (np.roll(x, -1, axis=1) - np.roll(x, 1, axis=1)) / 2
        u, v = across[:, :, 1, None], -across[:, :, 0, None]
        pull = np.stack([xx[:, None] * u + xy[:, None] * v, xy[:, None] * u + yy[:, None] * v], axis=2)
        here = np.einsum("eai,ecak->ecik", plane, pull)
        np.add.at(force, corners, here)
        largest = np.linalg.norm(here, axis=(2, 3)).max(axis=1, keepdims=True)
        np.add.at(terms, corners, np.broadcast_to(largest, corners.shape))
        edge = np.linalg.norm(np.roll(x, -1, axis=1) - x, axis=2)
        np.minimum.at(reach, corners, np.minimum(edge, np.roll(edge, 1, axis=1)))
    sure = plates.touch(np.ones(len(plates.flat), dtype=bool), count) & ~plates.touch(np.asarray(lost), count)
    return PlatesInStrain(turn, force, terms, reach, sure)
