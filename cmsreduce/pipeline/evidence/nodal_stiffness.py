"""Stiffness of a body at its nodes against the deck: evidence that no sum over the body has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import absolute_product, symmetric_product
from cmsreduce.model import FEModel, Finding, each_once
from cmsreduce.pipeline.evidence.deck_agreement import (
    BLIND,
    EXACT,
    NO_FORCE,
    PLACES,
    ROUNDINGS,
    Differences,
    known_dofs,
    named_nodes,
    ratio_in_words,
    row_directions,
    uniform_strains,
)
from cmsreduce.pipeline.evidence.mass_against_deck import away_from_supports
from cmsreduce.pipeline.evidence.nodal_plates import of_plates
from cmsreduce.pipeline.evidence.nodal_supports import of_solids_at_supports
from cmsreduce.pipeline.evidence.plates_in_strain import PlatesInStrain, plates_in_strain
from cmsreduce.read import STRAINS, StatedNodes

__all__ = ["NodesAgainstDeck", "nodes_against_deck"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]


@dataclass(frozen=True)
class NodesAgainstDeck:
    """Result of the comparison.

    Parameters
    ----------
    check : Finding
        Largest difference at a node, relative, beyond what the digits of matrix and coordinates allow.
    compared, nodes : int
        Nodes that were compared, and all nodes with rows.
    bending : (N,) bool
        True for nodes where bending and torsion of all bars and plates were compared, there or at their other ends.
    """

    check: Finding
    compared: int
    nodes: int
    bending: Flags


def nodes_against_deck(body: FEModel, stated: StatedNodes, free: bool = False) -> NodesAgainstDeck | None:
    """Compare the stiffness at each node with the elements of the deck there.

    Rows of nodes that bars and springs alone hold are compared entry by entry, relative to the stiffness of both nodes
    in each direction, so that twist and bending show beside stretch. Nodes of solids are compared by their forces
    under uniform strains, which show at every surface and at every face between two materials, and beside a support
    under those that leave it at rest; nodes of flat plates by their forces and moments under uniform strains and
    curvatures.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedNodes
        Stiffness of the elements.
    free : bool
        True if K is proven to resist no rigid motion, so that no node is next to a support.

    Returns
    -------
    NodesAgainstDeck or None
        None if no node is compared.
    """
    assert body.nodes is not None
    at = body.nodes.index(body.dofs.node)
    rows = np.flatnonzero((body.dofs.component > 0) & (at >= 0))
    E = row_directions(body, rows)
    whole = _whole(body, stated)
    # An element on a dof without rows gives its stiffness to others.
    lost = np.asarray(abs(stated.stiffness) @ np.repeat(~whole, 6).astype(float)).reshape(-1, 6).any(axis=1)
    known = stated.known & whole & ~lost
    bending = ~stated.barred
    plates, plated, strained = stated.plates, np.zeros(len(body.nodes), dtype=bool), None
    solid = known & stated.solid
    if plates is not None:
        plated = plates.touch(np.ones(len(plates.flat), dtype=bool), plated.size)
        if (solid & plated).any():
            strained = plates_in_strain(body, plates, rows)
            solid &= strained.sure | ~plated
    away = np.ones(len(body.nodes), dtype=bool)
    if solid.any() and not free:
        ids = each_once(body.dofs.node[rows])
        away[body.nodes.index(ids)] = away_from_supports(body, ids, stated.solids)
    found = [_of_solids(body, stated, E, rows, solid & away, strained)]
    if not away.all():
        alone = solid & ~away & ~plated & (stated.stiffness.diagonal().reshape(-1, 6) == 0).all(axis=1)
        found.append(of_solids_at_supports(body, stated, E, rows, alone))
    if plates is not None:
        of_these, shown = of_plates(body, stated, rows, known & plated)
        found.append(of_these)
        bending &= ~plates.touch(~shown, plated.size)
    by_entry = known & ~stated.solid & ~plated
    found.append(_of_bars(body, sp.csr_array(E @ stated.stiffness @ E.T), rows, by_entry))
    bending[found[-1].at] = True
    at, off, low, high = (
        np.concatenate([getattr(each, name) for each in found]) for name in ("at", "off", "low", "high")
    )
    if not at.size:
        return None
    order = np.argsort(-off, kind="stable")
    wrong = order[off[order] > EXACT]
    note = ""
    if wrong.size:
        # A node of plates on solids is compared twice.
        once = wrong[np.sort(np.unique(at[wrong], return_index=True)[1])]
        named = named_nodes(body.nodes.id[at[once]])
        first = wrong[0]
        known_ratio = np.isfinite(low[first]) and np.isfinite(high[first])
        words = ratio_in_words(float(low[first]), float(high[first])) if known_ratio else "forces that the deck has not"
        note = f"at node {named}; at the first {words}"
    check = Finding("stiffness of each node against the deck", float(off[order[0]]), EXACT, note)
    return NodesAgainstDeck(check, each_once(at).size, each_once(body.dofs.node[rows]).size, bending)


def _whole(body: FEModel, stated: StatedNodes) -> Flags:
    """True for nodes (N,) with a known motion in every dof that the elements resist."""
    assert body.nodes is not None
    known = known_dofs(body).rows(body.nodes.id[:, None], np.arange(1, 7)).reshape(-1, 6) >= 0
    turned = stated.stiffness.diagonal().reshape(-1, 6)[:, 3:].any(axis=1)
    return np.asarray(known[:, :3].all(axis=1) & (known[:, 3:].all(axis=1) | ~turned))


def _of_bars(body: FEModel, S: sp.csr_array, rows: Indices, known: Flags) -> Differences:
    """Differences of the rows of nodes that bars and springs hold."""
    assert body.nodes is not None
    place = body.nodes.index(body.dofs.node[rows])
    own = np.flatnonzero(known[place])
    at, of = np.unique(place[own], return_inverse=True)
    if not at.size:
        return Differences(at, np.zeros(0), np.zeros(0), np.zeros(0))
    S = sp.csr_array(S[own][:, own])
    K = sp.csr_array(sp.csr_array(body.K[rows[own]])[:, rows[own]])
    W = _scaling(S, of, (body.dofs.component[rows[own]] - 1).astype(np.int64), at.size)
    scaled = sp.csr_array(W.T @ K @ W)
    off = sp.csr_array(abs(sp.csr_array(W.T @ (K - S) @ W))).tocoo()
    # Wrong coordinates turn a stiff direction into a soft one.
    rate = ROUNDINGS * body.stiffness_rounding + PLACES * _place_errors(body, S, at, of)[of]
    size = abs(W)
    allowed = sp.csr_array(size.T @ (sp.diags_array(rate) @ (abs(K) + abs(S))) @ size)
    allowed = sp.csr_array(allowed + allowed.T)
    # SciPy gives a sparse array for no entries.
    limit = np.asarray(allowed[off.row, off.col]).ravel() if off.nnz else np.zeros(0)
    beyond = np.where(limit < BLIND, np.maximum(off.data - limit, 0.0), 0.0)
    worst = np.zeros(at.size)
    np.maximum.at(worst, off.row // 6, beyond)
    low, high = _ratios(scaled, at.size)
    return Differences(at, worst, low, high)


def _scaling(S: sp.csr_array, of: Indices, slot: Indices, count: int) -> sp.csr_array:
    """Motions (rows, 6 per node) of each node alone in which its own stiffness S is the identity."""
    A = S.tocoo()
    blocks, same = np.zeros((count, 6, 6)), of[A.row] == of[A.col]
    np.add.at(blocks, (of[A.row[same]], slot[A.row[same]], slot[A.col[same]]), A.data[same])
    own = np.einsum("kii->ki", blocks)
    scale = np.where(own > 0, 1 / np.sqrt(np.where(own > 0, own, 1.0)), 0.0)
    weight, V = np.linalg.eigh(blocks * scale[:, :, None] * scale[:, None, :])
    W = scale[:, :, None] * V * np.where(weight > NO_FORCE, 1 / np.sqrt(np.maximum(weight, NO_FORCE)), 0.0)[:, None, :]
    columns = (6 * of)[:, None] + np.arange(6)
    start = np.arange(0, 6 * of.size + 1, 6)
    return sp.csr_array((W[of, slot].ravel(), columns.ravel(), start), shape=(of.size, 6 * count))


def _place_errors(body: FEModel, S: sp.csr_array, at: Indices, of: Indices) -> Array:
    """Errors of the coordinates relative to the shortest element at each node."""
    assert body.nodes is not None
    error = float(np.max(body.nodes.xyz_rounding, initial=0.0))
    if not error:
        return np.zeros(at.size)
    first, second = (of[k] for k in S.nonzero())
    apart = np.linalg.norm(body.nodes.xyz[at[first]] - body.nodes.xyz[at[second]], axis=1)
    shortest = np.full(at.size, float(np.ptp(body.nodes.xyz, axis=0).max()))
    np.minimum.at(shortest, first[apart > 0], apart[apart > 0])
    return np.asarray(error / np.maximum(shortest, error))


def _ratios(scaled: sp.csr_array, count: int) -> tuple[Array, Array]:
    """Least and largest stiffness of each node, over the motions that the deck resists."""
    A = scaled.tocoo()
    blocks, same = np.zeros((count, 6, 6)), A.row // 6 == A.col // 6
    blocks[A.row[same] // 6, A.row[same] % 6, A.col[same] % 6] = A.data[same]
    weight = np.linalg.eigvalsh((blocks + blocks.transpose(0, 2, 1)) / 2)
    # Motions that are not compared have no stiffness here.
    least = np.where(weight > NO_FORCE, weight, np.inf).min(axis=1)
    return np.asarray(np.where(np.isfinite(least), least, 0.0)), np.asarray(weight[:, -1])


def _of_solids(
    body: FEModel,
    stated: StatedNodes,
    E: sp.csr_array,
    rows: Indices,
    known: Flags,
    plates: PlatesInStrain | None,
) -> Differences:
    """Differences of the forces of nodes of solids, and of plates on them, under uniform strains."""
    assert body.nodes is not None
    ids, of = np.unique(body.dofs.node[rows], return_inverse=True)
    at = body.nodes.index(ids)
    judged = known[at]
    if not judged.any():
        return Differences(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0), np.zeros(0))
    centre = body.nodes.xyz.mean(axis=0)
    U = uniform_strains(body.dofs, body.nodes, centre)
    x, every = body.nodes.xyz - centre, np.zeros((len(body.nodes), 6, len(STRAINS)))
    for k, (i, j) in enumerate(STRAINS):
        every[:, i, k] += x[:, j]
        every[:, j, k] += x[:, i] if i != j else 0.0
    force, own_terms = np.zeros_like(every), stated.terms
    force[:, :3] = stated.force
    errors = ROUNDINGS * body.stiffness_rounding * abs(U) + PLACES * float(np.max(body.nodes.xyz_rounding, initial=0.0))
    counted = np.ones(rows.size, dtype=bool)
    if plates is not None:
        every[:, 3:], own_terms = plates.turn, own_terms + plates.terms
        force[:, :3] += plates.force
        turns = body.dofs.component[rows] > 3
        U[rows[turns]] = (E @ every.reshape(-1, len(STRAINS)))[turns]
        place = at[of]
        # Normals turn with the corners of plates; their moments are compared by fields of their own.
        errors[rows[turns]] /= np.where(np.isfinite(plates.reach), plates.reach, 1.0)[place[turns], None]
        counted = ~(turns & np.isfinite(plates.reach[place]))
    flat = every.reshape(-1, len(STRAINS))
    # A bar gives a force with its other end at this node's place.
    stiff = np.asarray(E @ (stated.stiffness @ flat + force.reshape(-1, len(STRAINS)))) * counted[:, None]
    found = symmetric_product(body.K)(U)[rows] * counted[:, None]
    allowed = absolute_product(body.K)(errors)[rows] * counted[:, None]
    beyond = np.maximum(abs(found - stiff) - allowed, 0.0)
    sums = [np.bincount(of, np.sum(part, axis=1)) for part in (beyond**2, allowed**2, found * stiff, stiff**2)]
    off, noise, product, square = sums
    terms = own_terms[at] + np.linalg.norm(
        np.asarray(abs(stated.stiffness) @ abs(flat)).reshape(len(body.nodes), -1)[at], axis=1
    )
    judged &= np.sqrt(noise) < BLIND * terms
    off, terms, product, square = (part[judged] for part in (off, terms, product, square))
    ratio = np.divide(product, square, out=np.full(off.size, np.nan), where=square > (EXACT * terms) ** 2)
    return Differences(at[judged], np.sqrt(off) / terms, ratio, ratio)
