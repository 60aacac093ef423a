"""Masses of a body at its nodes against those of the deck, also where supports hold it, and by direction."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import absolute_product, symmetric_product
from cmsreduce.model import FEModel, Finding, each_once
from cmsreduce.pipeline.evidence.deck_agreement import EXACT, known_dofs, masses_move, named_nodes, ratio_in_words
from cmsreduce.pipeline.evidence.mass_at_supports import own_masses
from cmsreduce.pipeline.evidence.nodal_mass import momentum_of_nodes
from cmsreduce.read import StatedMass, StatedNodes

__all__ = [
    "away_from_supports",
    "directions_against_deck",
    "followers_in_words",
    "mass_order_by_deck",
    "nodes_times_deck",
]

Array = NDArray[np.float64]

# Masses of elements in a deck have four digits or more.
_SAME = 1e-3
# Of a condensed body: masses this different are of another node, if they are this much like those of the other.
_OTHER, _LIKE = 0.5, 0.2
# More nodes than this share have one ratio to the deck where no mass is moved to other nodes.
_MOST = 0.5
# Force against translation, relative to its parts, of a node that no support holds.
_FORCE = 1e-6
# Nodes named in a message, and those that are looked at for an exchange.
_NAMED, _MOST_NODES = 5, 600
# Of the masses that meet at a node: a coupling of its directions below it is rounding of sums over an element.
_ONE_MASS = 1e-6
# Roundings of the file that add up over a node.
_ROUNDINGS = 1e3
# Of the size of the body: the last of the digits of coordinates in a deck.
_ONE_PLACE = 1e-6
_TOGETHER = "as a whole at nodes that constraints join: {}"


def mass_order_by_deck(body: FEModel, nodal: Array, comparable: bool) -> Finding | None:
    """Compare the mass at each node with that of the deck.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    nodal : (N,) float64
        Mass of the deck at each node.
    comparable : bool
        True if no mass is lost at nodes that are held.

    Returns
    -------
    Finding or None
        Largest difference at a node relative to its mass, or of nodes together that constraints join. None if no
        exchange of nodes explains a difference, as where masses are spread over nodes, or if heavy nodes have no rows
        and no exchange is found.
    """
    assert body.nodes is not None
    ids, P = momentum_of_nodes(body)
    at = body.nodes.index(ids)
    found, stated = np.trace(P, axis1=1, axis2=2) / 3, nodal[at]
    off = _apart(found, stated, stated.max(initial=0.0))
    joined = _joined(body, nodal, ids, P) if comparable else None
    whole = joined is not None
    # Condensation moves a part of the mass of each node to its neighbours.
    wrong_by, like = (_SAME, _SAME) if whole else (_OTHER, _LIKE)
    name, note = "mass of each node against the deck", ""
    if joined is not None and joined.any():
        off[joined], note = 0.0, _TOGETHER.format(named_nodes(ids[joined]))
    wrong = np.flatnonzero((off > wrong_by) & (whole or away_from_supports(body, ids)))
    if not wrong.size:
        return Finding(name, float(off.max(initial=0.0)), _SAME, note) if whole else None
    wrong = wrong[np.argsort(-off[wrong], kind="stable")][:_MOST_NODES]
    here = _apart(found[wrong][:, None], stated[wrong], stated.max()) <= like
    exchanged = [(k, int(here[k].argmax())) for k in range(wrong.size) if here[k].any() and here[:, k].any()]
    if not exchanged or (whole and len(exchanged) < wrong.size):
        return None
    named = ", ".join(f"node {ids[wrong[k]]} has that of node {ids[wrong[j]]}" for k, j in exchanged[:_NAMED])
    return Finding(name, float(off.max()), _SAME, f"{len(exchanged)} nodes have each other's mass: {named}")


def nodes_times_deck(body: FEModel, stated: StatedMass, solids: StatedNodes | None = None) -> Finding | None:
    """Compare the masses of a held body's nodes with those of the deck.

    Nodes next to the supports are compared if they are nodes of solids of one kind.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedMass
        Mass that the deck states.
    solids : StatedNodes, optional
        Its solids.

    Returns
    -------
    Finding or None
        Difference of the ratio that most nodes have, or else the largest one of a node, in each direction. None if
        these nodes have no ratio in common, or if the masses of nodes that constraints join are not theirs together.
        Its name says so where all nodes with rows are compared.
    """
    assert body.nodes is not None
    nodal = stated.nodal
    ids, P = momentum_of_nodes(body)
    at = body.nodes.index(ids)
    # Along a direction without rows a node shows no mass.
    full = (body.dofs.rows(ids[:, None], np.arange(1, 4)).reshape(-1, 3) >= 0).all(axis=1)
    found, share = np.trace(P, axis1=1, axis2=2) / 3, nodal[at]
    # A light node here is not one there if the deck has the density of one part in another unit.
    full &= (abs(share) > _SAME * abs(nodal).max(initial=0.0)) | (abs(found) > _SAME * abs(found).max(initial=0.0))
    full &= share != 0
    whole = full & away_from_supports(body, ids, () if solids is None else solids.solids)
    most = float(np.median(found[whole] / share[whole])) if whole.any() else 0.0
    joined = _joined(body, most * nodal, ids, P, whole)
    if joined is None:
        return None
    whole &= ~joined
    ratio = np.divide(found, share, out=np.ones(ids.size), where=whole)
    if (abs(ratio[whole] - most) <= _SAME * abs(most)).sum() <= _MOST * whole.sum():
        return None
    name = "mass against the deck, of nodes away from supports"
    if abs(most - 1) > EXACT:
        return Finding(name, abs(most - 1), EXACT, ratio_in_words(most, most))
    off = np.zeros(ids.size)
    off[whole] = abs(P[whole] / share[whole][:, None, None] - np.eye(3)).max(axis=(1, 2))
    rest = np.flatnonzero(full & ~joined)
    if solids is not None:
        beside, times = own_masses(body, stated, solids, ids[rest], whole[rest])
        ratio[rest[beside]], off[rest[beside]] = times[beside], abs(times[beside] - 1)
        whole[rest[beside]] = True
    if (whole | joined).all():
        name = "mass against the deck, of all nodes"
    order = np.argsort(-off, kind="stable")
    wrong, first = order[off[order] > EXACT], order[0]
    words = "in one of its directions" if abs(ratio[first] - 1) <= EXACT else ratio_in_words(ratio[first], ratio[first])
    note = _TOGETHER.format(named_nodes(ids[joined])) if joined.any() else ""
    note = f"at node {named_nodes(ids[wrong])}; at the first {words}" if wrong.size else note
    return Finding(name, float(off[first]), EXACT, note)


def directions_against_deck(body: FEModel, stated: StatedMass) -> Finding | None:
    """Coupling of x, y and z by the mass of solids, which have one mass in all directions, also between their nodes.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedMass
        Masses of its deck. A rod has another mass along it than across it: nodes of rods, bars and plates are left out.

    Returns
    -------
    Finding or None
        Largest difference at a node relative to the masses that meet there. None if other dofs than translations have
        mass, or if a node with mass lacks rows that no support took.
    """
    assert body.nodes is not None
    known = known_dofs(body).rows(body.nodes.id[stated.nodal != 0][:, None], np.arange(1, 4))
    moving = (body.dofs.component > 0) & (body.dofs.component <= 3)
    if (known < 0).any() or body.M.diagonal()[~moving].any():
        return None
    ids = each_once(body.dofs.node[moving])
    rows = body.dofs.rows(ids[:, None], np.arange(1, 4)).reshape(-1, 3)
    whole = (rows >= 0).all(axis=1)
    ids, rows = ids[whole], rows[whole]
    axes = body.rigid_shapes[rows][:, :, :3]
    # Weights in no order: what a coupling adds does not cancel.
    weight = np.zeros((body.n, 1))
    weight[rows, 0] = 1 + np.random.default_rng(0).random((ids.size, 1))
    P = np.einsum("kra,krb->kab", axes, symmetric_product(body.M)(weight * body.rigid_shapes[:, :3])[rows])
    meeting = absolute_product(body.M)(weight)[rows, 0].max(axis=1)
    own = np.trace(P, axis1=1, axis2=2)[:, None, None] / 3 * np.eye(3)
    off = np.divide(abs(P - own).max(axis=(1, 2)), meeting, out=np.zeros(ids.size), where=meeting > 0)
    if stated.turning is not None:
        off[stated.turning[body.nodes.index(ids)].any(axis=1)] = 0.0
    limit = max(_ONE_MASS, _ROUNDINGS * body.rounding)
    wrong = np.argsort(-off, kind="stable")[: (off > limit).sum()]
    note = f"at node {named_nodes(ids[wrong])}: solids have one mass in all directions" if wrong.size else ""
    return Finding("mass matrix: coupling of x, y and z", float(off.max(initial=0.0)), limit, note)


def followers_in_words(body: FEModel, nodal: Array) -> str:
    """Remark that the masses of nodes that lost rows to others are not proven; empty without such nodes."""
    assert body.nodes is not None
    ids = body.nodes.id[~masses_move(body, nodal)]
    return f"; masses that constraints move to other nodes are not proven: node {named_nodes(ids)}" if ids.size else ""


def _joined(
    body: FEModel, nodal: Array, ids: NDArray[np.int64], P: Array, seen: NDArray[np.bool_] | bool = True
) -> NDArray[np.bool_] | None:
    """Nodes (k,) of hinges: those that lost rows to another one at their place, and those that lead them.

    The elements of one that follows act on the one that leads, so that K couples both with the nodes around. Which node
    leads one without rows, or one at another place, is not known.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    nodal : (N,) float64
        Mass of the deck at each node.
    ids : (k,) int64
        Nodes with rows.
    P : (k, 3, 3) float64
        Their momentum under translations.
    seen : (k,) bool
        True for those whose whole mass is in the matrix.

    Returns
    -------
    (k,) bool or None
        None if a place has not one node that leads, if their mass is not that of the deck in each direction, or if the
        rows that are left of a node that follows do not have its mass.
    """
    assert body.nodes is not None
    xyz, follows = body.nodes.xyz, ~masses_move(body, nodal)
    joined = np.zeros(ids.size, dtype=bool)
    if not follows.any():
        return joined
    if follows.sum() > _MOST_NODES:
        return None
    reach, own = _ONE_PLACE * float(np.ptp(xyz, axis=0).max()), np.sqrt(abs(body.K.diagonal()))
    at, largest = body.nodes.index(ids), abs(nodal).max()
    for place in {tuple(np.flatnonzero((abs(xyz - x) <= reach).all(axis=1)).tolist()) for x in xyz[follows]}:
        here = set(body.nodes.id[list(place)])
        around = {k: _coupled_nodes(body, int(body.nodes.id[k]), own) - here for k in place}
        following = [k for k in place if follows[k]]
        leading = [k for k in place if not follows[k] and all(around[k] & around[other] for other in following)]
        if len(leading) != 1 or not (np.isin(at, leading) & seen).any():
            return None
        one = np.isin(at, [*following, *leading])
        mass = nodal[[*following, *leading]].sum()
        off = abs(P[one].sum(axis=0) - mass * np.eye(3)).max()
        for k in np.flatnonzero(one & follows[at]):
            axes = body.nodes.frame[at[k]][body.dofs.rows(ids[k], np.arange(1, 4)) >= 0]
            off = max(off, abs(P[k] - nodal[at[k]] * axes.T @ axes).max())
        if off > _SAME * max(abs(mass), _SAME * largest):
            return None
        joined |= one
    return joined


def _coupled_nodes(body: FEModel, node: int, own: Array) -> set[int]:
    """Nodes that K couples with one, by more than rounding; ``own`` are the roots of its diagonal (n,)."""
    rows = np.flatnonzero(body.dofs.node == node)
    part = sp.coo_array(body.K[:, rows])
    least = max(_FORCE, _ROUNDINGS * body.stiffness_rounding) * own[part.row] * own[rows][part.col]
    return set(body.dofs.node[part.row[abs(part.data) > least]])


def away_from_supports(
    body: FEModel, ids: NDArray[np.int64], solids: Sequence[NDArray[np.int64]] = ()
) -> NDArray[np.bool_]:
    """True for nodes of whose momentum no support takes a part.

    A support resists translation of the nodes that K couples with it. Forces of quadratic solids may cancel: nodes that
    share one with a support, by the positions (e, k) of its nodes, are not away either.
    """
    assert body.nodes is not None
    T = body.rigid_shapes[:, :3]
    force, parts = abs(symmetric_product(body.K)(T)).max(axis=1), absolute_product(body.K)(abs(T)).max(axis=1)
    loud = force > max(_FORCE, _ROUNDINGS * body.stiffness_rounding) * parts
    beside = np.zeros(len(body.nodes), dtype=bool)
    if body.constrained is not None:
        # Forces of supports along some axes may cancel, as in a plane of symmetry that holds a node on its both sides.
        translations = body.constrained.component[:, None] == np.arange(1, 4)
        held = body.constrained.node[translations.any(axis=1)]
        partly = np.isin(body.dofs.node, held)
        loud |= absolute_product(body.K)(partly[:, None].astype(float))[:, 0] > 0
        at_rest = np.isin(body.nodes.id, held)
        for part in solids:
            beside[part[at_rest[part].any(axis=1)]] = True
    return ~(np.isin(ids, body.dofs.node[loud]) | beside[body.nodes.index(ids)])


def _apart(found: Array, stated: Array, largest: float) -> Array:
    """Relative difference of masses; one of less than a thousandth of the largest is compared with that."""
    return np.asarray(
        abs(found - stated) / np.maximum(np.maximum(abs(found), abs(stated)), max(_SAME * largest, 1e-300))
    )
