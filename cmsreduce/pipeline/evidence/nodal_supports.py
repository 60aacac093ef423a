"""Stiffness of solids at nodes beside supports against the deck.

The matrices have no columns for nodes at rest. A linear motion that leaves the nodes of one support at rest, as any
that vanishes in the plane of a clamped face, makes the forces of its strain at the nodes beside this support.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.model import FEModel
from cmsreduce.pipeline.evidence.deck_agreement import (
    BLIND,
    EXACT,
    PLACES,
    ROUNDINGS,
    Differences,
    fields_at_rest,
    supported_dofs,
    uniform_strains,
)
from cmsreduce.read import StatedNodes

__all__ = ["of_solids_at_supports"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# Supports that are looked at; each takes a product with its rows.
_MOST = 100


def of_solids_at_supports(
    body: FEModel, stated: StatedNodes, E: sp.csr_array, rows: Indices, judged: Flags
) -> Differences:
    """Differences of the forces of nodes of solids that share an element with one support.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedNodes
        Stiffness of the elements.
    E : (r, 6 N) sparse array
        Directions of the rows.
    rows : (r,) int64
        Rows of the matrices at nodes.
    judged : (N,) bool
        Nodes of solids alone, all of which are known, and whose motion is known.
    """
    assert body.nodes is not None
    held = supported_dofs(body)
    held = held[(held.component <= 3) & (held.component > 0) & (body.nodes.index(held.node) >= 0)]
    support, beside = _supports(stated.solids, body.nodes.index(held.node), judged)
    place = body.nodes.index(body.dofs.node[rows])
    found = [Differences(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0))]
    centre = body.nodes.xyz.mean(axis=0)
    for number in np.unique(beside[beside >= 0])[:_MOST]:
        fields = fields_at_rest(body, held[support[body.nodes.index(held.node)] == number])
        mine = np.flatnonzero(beside[place] == number)
        if not fields.shape[1] or not mine.size:
            continue
        # K is symmetric: its columns are its rows.
        K = body.K[:, rows[mine]]
        touched = np.unique(K.indices)
        K = sp.csc_array(K[touched])
        U = (body.rigid_shapes[touched] @ fields[:6]) + (
            uniform_strains(body.dofs[touched], body.nodes, centre) @ fields[6:]
        )
        forces = K.T @ U
        force = np.zeros((len(body.nodes), 6, fields.shape[1]))
        force[:, :3] = stated.force @ fields[6:]
        stiff = E[mine] @ force.reshape(-1, fields.shape[1])
        off_places = PLACES * float(np.max(body.nodes.xyz_rounding, initial=0.0)) * abs(fields[3:]).max(axis=0)
        allowed = abs(K).T @ (ROUNDINGS * body.stiffness_rounding * abs(U) + off_places)
        beyond = np.maximum(abs(forces - stiff) - allowed, 0.0)
        at, of = np.unique(place[mine], return_inverse=True)
        off, noise, product, square = (
            np.bincount(of, part.sum(axis=1)) for part in (beyond**2, allowed**2, forces * stiff, stiff**2)
        )
        terms = stated.terms[at]
        sure = np.sqrt(noise) < BLIND * terms
        ratio = np.divide(product, square, out=np.full(at.size, np.nan), where=square > (EXACT * terms) ** 2)
        found.append(Differences(at[sure], np.sqrt(off[sure]) / terms[sure], ratio[sure], ratio[sure]))
    return Differences(
        *(np.concatenate([getattr(part, name) for part in found]) for name in ("at", "off", "low", "high"))
    )


def _supports(solids: tuple[Indices, ...], held: Indices, judged: Flags) -> tuple[Indices, Indices]:
    """Number of the support of each node at rest (N,), and of the one that others share an element with; -1 for none.

    Nodes at rest in elements that share one are of one support. A node beside two has none.
    """
    count = judged.size
    at_rest = np.zeros(count, dtype=bool)
    at_rest[held] = True
    touching = [part[at_rest[part].any(axis=1)] for part in solids]
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    start = count
    for part in touching:
        element = np.broadcast_to(np.arange(start, start + len(part))[:, None], part.shape)
        pairs.append(np.column_stack([part.ravel(), element.ravel()]))
        start += len(part)
    node, element = np.concatenate(pairs).T
    own = at_rest[node]
    joined = sp.coo_array((np.ones(own.sum()), (node[own], element[own])), shape=(start, start))
    label = connected_components(joined, directed=False)[1]
    low, high = np.full(count, start), np.full(count, -1)
    np.minimum.at(low, node, label[element])
    np.maximum.at(high, node, label[element])
    support = np.where(at_rest, label[:count], -1)
    return support, np.where(judged & (low == high), high, -1)
