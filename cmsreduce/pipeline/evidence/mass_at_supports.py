"""Masses of solids at nodes beside supports against the deck.

A consistent mass shares some of the mass of such a node with nodes that have no rows. Its own entry is whole: it is one
share of the mass of its node in all affine solids of one kind, which nodes away from supports show.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.pipeline.evidence.deck_agreement import EXACT
from cmsreduce.read import SAME_PLACE, SOLIDS, StatedMass, StatedNodes, are_affine, integrals

__all__ = ["own_masses"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# Nodes away from supports that show the share of their kind.
_FEWEST = 3
# Gauss points each way, exact for the shares of nodes; and their digits.
_POINTS, _DIGITS = 3, 6


def own_masses(
    body: FEModel, stated: StatedMass, solids: StatedNodes, ids: Indices, away: Flags
) -> tuple[Flags, Array]:
    """Compare the entries on the diagonal of the mass at nodes beside supports with those away from them.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedMass
        Mass that its deck states.
    solids : StatedNodes
        Its solids.
    ids : (k,) int64
        Nodes with all rows of their translations and with mass.
    away : (k,) bool
        True for those that no support takes a part of.

    Returns
    -------
    compared : (k,) bool
        Nodes of one kind of affine solids alone, which has one share at nodes away from supports.
    times : (k,) float64
        How many times that of the deck theirs is; else 1.
    """
    assert body.nodes is not None
    at = body.nodes.index(ids)
    kind = _kinds(solids, body.nodes.xyz)[at]
    for other in (stated.points, stated.turning, stated.uneven):
        if other is not None:
            kind[other[at].reshape(at.size, -1).any(axis=1)] = -1
    # The trace of a block is the same along all axes.
    own = body.M.diagonal()[body.dofs.rows(ids[:, None], np.arange(1, 4))].reshape(-1, 3).sum(axis=1)
    share = own / (3 * stated.nodal[at])
    compared, times = np.zeros(ids.size, dtype=bool), np.ones(ids.size)
    for number in np.unique(kind[~away & (kind >= 0)]):
        known = share[away & (kind == number)]
        if known.size < _FEWEST or np.ptp(known) > EXACT * abs(one := float(np.median(known))):
            continue
        beside = ~away & (kind == number)
        compared |= beside
        times[beside] = share[beside] / one
    return compared, times


def _kinds(stated: StatedNodes, xyz: Array) -> Indices:
    """Number (N,) of the kind of solid that each node belongs to, and of its share in it; -1 for all others.

    The edges of a wedge from triangle to triangle have other shares than those around both.
    """
    kind = np.full(len(xyz), -1, dtype=np.int64)
    several = ~stated.known | ~stated.solid | stated.barred
    if stated.plates is not None:
        several |= stated.plates.touch(np.ones(len(stated.plates.corners), dtype=bool), len(xyz))
    number = 0
    for nodes in stated.solids:
        solid = next((each for each in SOLIDS.values() if len(each.places) == nodes.shape[1]), None)
        if solid is None:
            several[nodes] = True
            continue
        several[nodes[~are_affine(solid, xyz[nodes], SAME_PLACE)]] = True
        shares = integrals(solid, solid.places[None], _POINTS).shares[0].round(_DIGITS)
        for share in np.unique(shares):
            own = nodes[:, shares == share]
            several[own[~np.isin(kind[own], (-1, number))]] = True
            kind[own] = number
            number += 1
    kind[several] = -1
    return kind
