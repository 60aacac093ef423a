"""Stiffness of bars and springs between two nodes against the deck, whatever other elements are at these nodes.

The block of a matrix between two nodes has all of the stiffness of what joins them alone: the rest follows by
equilibrium. A sum over the nodes of solids or plates hides a soft spring among them.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Finding, cross_matrix
from cmsreduce.pipeline.evidence.deck_agreement import (
    BLIND,
    EXACT,
    NO_FORCE,
    PLACES,
    ROUNDINGS,
    known_dofs,
    ratio_in_words,
)
from cmsreduce.read import StatedNodes

__all__ = ["links_against_deck"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_NAMED = 3


def links_against_deck(body: FEModel, stated: StatedNodes, turning: Indices) -> Finding | None:
    """Compare the block between two nodes with the bars and springs that alone join them.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedNodes
        Stiffness of the elements.
    turning : (t,) int64
        Positions of the nodes that bars and plates turn.

    Returns
    -------
    Finding or None
        Largest difference in a motion of one node, relative to the stiffness of the link in it. None without links, or
        of a condensed body, whose omitted dofs couple others.
    """
    assert body.nodes is not None
    links = stated.links
    if links is None or not len(links) or body.sets.get("q", np.zeros(0)).size:
        return None
    if (known_dofs(body).rows(body.nodes.id[turning][:, None], np.arange(4, 7)) < 0).any():
        return None
    between, size = _blocks_of_rows(body, links)
    given = _blocks(stated.stiffness, links)
    # Dofs without rows are held: their part of the deck is not in the matrix.
    first, second = (_moving(body, links[:, k]) for k in range(2))
    found = first.transpose(0, 2, 1) @ between @ second
    stated_here = first.transpose(0, 2, 1) @ first @ given @ second.transpose(0, 2, 1) @ second
    apart = body.nodes.xyz[links[:, 1]] - body.nodes.xyz[links[:, 0]]
    carried = np.tile(np.eye(6), (len(links), 1, 1))
    carried[:, :3, 3:] = -cross_matrix(apart)
    scale, sure = _scaling(-given @ carried)
    sure &= abs(stated_here).any(axis=(1, 2))
    if not sure.any():
        return None
    off, own, one = (
        scale.transpose(0, 2, 1) @ part @ carried @ scale for part in (found - stated_here, -found, -stated_here)
    )
    distance = np.linalg.norm(apart, axis=1)
    error = float(np.max(body.nodes.xyz_rounding, initial=0.0))
    # Points at one place are printed alike.
    far = distance > error
    rate = ROUNDINGS * body.stiffness_rounding + PLACES * np.divide(error, distance, out=np.zeros(far.size), where=far)
    part = abs(first).transpose(0, 2, 1) @ (abs(between) * rate[:, None, None] + size) @ abs(second)
    part = part + rate[:, None, None] * abs(given)
    allowed = abs(scale).transpose(0, 2, 1) @ part @ abs(carried) @ abs(scale)
    beyond = np.where(allowed < BLIND, np.maximum(abs(off) - allowed, 0.0), 0.0).max(axis=(1, 2))
    beyond[~sure] = 0.0
    wrong = np.argsort(-beyond, kind="stable")[: int((beyond > EXACT).sum())]
    note = ""
    if wrong.size:
        named = ", ".join("{} and {}".format(*body.nodes.id[links[k]]) for k in wrong[:_NAMED])
        more = f" and {wrong.size - _NAMED} more pairs" if wrong.size > _NAMED else ""
        resisted = one[wrong[0]].diagonal() > BLIND
        ratio = own[wrong[0]].diagonal()[resisted] / one[wrong[0]].diagonal()[resisted]
        note = f"between nodes {named}{more}; at the first {ratio_in_words(*_range(ratio))}"
    name = "stiffness of bars and springs between two nodes against the deck"
    return Finding(name, float(beyond.max()), EXACT, note)


def _range(ratio: Array) -> tuple[float, float]:
    """Least and largest; of a link in motions without stiffness in the deck, infinite."""
    return (float(ratio.min()), float(ratio.max())) if ratio.size else (np.inf, np.inf)


def _moving(body: FEModel, at: Indices) -> Array:
    """Directions (p, 6, 6) of the rows of some nodes along basic axes; zero where a dof has no row."""
    assert body.nodes is not None
    there = body.dofs.rows(body.nodes.id[at][:, None], np.arange(1, 7)).reshape(-1, 6) >= 0
    frame = np.zeros((at.size, 6, 6))
    frame[:, :3, :3] = frame[:, 3:, 3:] = body.nodes.frame[at]
    return np.asarray(frame * there[:, :, None])


def _blocks_of_rows(body: FEModel, links: Indices) -> tuple[Array, Array]:
    """Blocks (p, 6, 6) of the stiffness between the rows of two nodes, and the arithmetic's error of each entry."""
    assert body.nodes is not None
    nodes = np.unique(links)
    rows = body.dofs.rows(body.nodes.id[nodes][:, None], np.arange(1, 7)).ravel()
    own = np.flatnonzero(rows >= 0)
    wide = sp.csr_array((np.ones(own.size), (own, rows[own])), shape=(rows.size, body.n))
    at = np.searchsorted(nodes, links)
    blocks = _blocks(sp.csr_array(wide @ body.K @ wide.T), at)
    root = np.sqrt(abs(wide @ body.K.diagonal())).reshape(-1, 6)
    return blocks, np.finfo(float).eps * ROUNDINGS * root[at[:, 0], :, None] * root[at[:, 1], None, :]


def _blocks(A: sp.csr_array, pairs: Indices) -> Array:
    """Blocks (p, 6, 6) of a matrix with six rows a node."""
    entries, count = sp.coo_array(A), A.shape[0] // 6
    key = pairs[:, 0] * count + pairs[:, 1]
    order = np.argsort(key)
    wanted = (entries.row // 6).astype(np.int64) * count + entries.col // 6
    place = np.searchsorted(key[order], wanted).clip(max=len(key) - 1)
    hit = key[order][place] == wanted
    out = np.zeros((len(pairs), 6, 6))
    np.add.at(out, (order[place[hit]], entries.row[hit] % 6, entries.col[hit] % 6), entries.data[hit])
    return out


def _scaling(P: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Motions (p, 6, 6) of one node in which the stiffness of its link is one, and links that have such motions.

    Springs between points apart that are off their line resist rigid motion: their matrix is not symmetric here.
    """
    uneven = abs(P - P.transpose(0, 2, 1)).max(axis=(1, 2)) > EXACT * abs(P).max(axis=(1, 2))
    P = (P + P.transpose(0, 2, 1)) / 2
    own = np.einsum("kii->ki", P)
    most = own.reshape(-1, 2, 3).max(axis=2).repeat(3, axis=1)
    weight = np.where(own > NO_FORCE * most, own, most)
    scale = np.where(weight > 0, 1 / np.sqrt(np.where(weight > 0, weight, 1.0)), 0.0)
    weight, V = np.linalg.eigh(P * scale[:, :, None] * scale[:, None, :])
    sure = (weight >= -EXACT).all(axis=1) & ~uneven
    return scale[:, :, None] * V / np.sqrt(np.where(weight > NO_FORCE, weight, 1.0))[:, None, :], sure
