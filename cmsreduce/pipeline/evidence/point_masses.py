"""Point masses of a deck in a mass matrix: their offsets and inertias at each node, and the mass without them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Finding
from cmsreduce.pipeline.evidence.deck_agreement import known_dofs, masses_move, named_nodes, row_directions
from cmsreduce.read import StatedMass

__all__ = ["points_against_deck", "without_points"]

# Inertias and offsets of decks have four digits or more.
_SAME = 1e-3


def points_against_deck(body: FEModel, stated: StatedMass) -> Finding | None:
    """Compare the inertia of each point mass, and its coupling by an offset, with the rows of its node.

    Other elements add to both; what they add at most is left out.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedMass
        Masses of its deck.

    Returns
    -------
    Finding or None
        Largest difference relative to the inertia of the node's masses; of a coupling, relative to the root of mass
        times inertia. None if no node with rotations has an inertia or offset, or if others carry the mass or the
        inertia of a node, which has neither rows nor supports then.
    """
    assert body.nodes is not None
    if stated.points is None or stated.turning is None:
        return None
    points, turning, ids = stated.points, stated.turning, body.nodes.id
    rows = body.dofs.rows(ids[:, None], np.arange(1, 7)).reshape(-1, 6)
    inertia = abs(points[:, 3:, 3:]).max(axis=(1, 2))
    turns = known_dofs(body).rows(ids[inertia > 0][:, None], np.arange(4, 7)) >= 0
    if not masses_move(body, stated.nodal).all() or not turns.all():
        return None
    at = np.flatnonzero((inertia > 0) & (rows >= 0).all(axis=1) & np.isfinite(turning).all(axis=1))
    if not at.size:
        return None
    own = rows[at]
    # The masses along the rows' own axes.
    frames = np.zeros((at.size, 6, 6))
    frames[:, :3, :3] = frames[:, 3:, 3:] = body.nodes.frame[at]
    part = sp.coo_array(sp.csr_array(body.M)[own.ravel()][:, own.ravel()])
    same = part.row // 6 == part.col // 6
    rest = -(frames @ points[at] @ frames.transpose(0, 2, 1))
    np.add.at(rest, (part.row[same] // 6, part.row[same] % 6, part.col[same] % 6), part.data[same])
    coupled = np.maximum(abs(rest[:, 3:, :3]).max(axis=(1, 2)) - turning[at, 0], 0.0)
    turned = np.maximum(abs(rest[:, 3:, 3:]).max(axis=(1, 2)) - turning[at, 1], 0.0)
    mass = np.maximum(points[at, 0, 0], stated.nodal[at])
    off = np.maximum(turned / inertia[at], coupled / np.sqrt(inertia[at] * np.maximum(mass, np.finfo(float).tiny)))
    wrong = np.argsort(-off, kind="stable")[: int((off > _SAME).sum())]
    note = f"at node {named_nodes(ids[at[wrong]])}" if wrong.size else ""
    return Finding("inertia of each point mass against the deck", float(off.max()), _SAME, note)


def without_points(body: FEModel, points: NDArray[np.float64] | None) -> sp.csc_array:
    """Mass matrix without masses (N, 6, 6) of the deck at single nodes, along basic axes.

    Point masses say nothing about the order of the rest, and masses that differ by direction are not those of a body.
    """
    if points is None or not points.any():
        return body.M
    assert body.nodes is not None
    rows = np.flatnonzero((body.dofs.component > 0) & (body.nodes.index(body.dofs.node) >= 0))
    at = np.arange(len(body.nodes))
    blocks = sp.bsr_array((points, at, np.append(at, at.size)), shape=(6 * at.size, 6 * at.size))
    E = row_directions(body, rows)
    masses = sp.coo_array(E @ sp.csr_array(blocks) @ E.T)
    more = sp.coo_array((masses.data, (rows[masses.row], rows[masses.col])), shape=body.M.shape)
    return sp.csc_array(body.M - more)
