"""Order of the rows of each node in a mass matrix, and other orders of the nodes that couple the same pairs.

Pairs of nodes show neither which row of a node is which, nor a mirror image of a regular mesh.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import unchanged_in
from cmsreduce.model import FEModel, Finding, cross_matrix, each_once
from cmsreduce.pipeline.evidence.mass_against_deck import away_from_supports
from cmsreduce.pipeline.evidence.nodal_mass import moments_toward_neighbours
from cmsreduce.read import mirror_image
from cmsreduce.verify import REALISABLE, free_mass, inertia_excess

__all__ = ["one_mass", "order_that_shows"]

Array = NDArray[np.float64]

_EXCESS = "inertia: beyond what mass can have"
# Of the mass of a node, or of its inertia: what is more is another direction.
_SAME = 1e-6
# Roundings of the file that add up over a node.
_ROUNDINGS = 1e3
# Rows that are looked at first.
_FEW_ROWS = 200


def one_mass(body: FEModel, limit: float, beside: bool) -> list[Finding]:
    """Compare the masses along x, y and z at one place, and their inertia with that of any mass.

    Parameters
    ----------
    body : FEModel
        With its ties.
    limit : float
        Relative difference that round-off may leave.
    beside : bool
        True if some nodes stand next to the ground.
    """
    free = free_mass(body, beside)
    along = free.along
    if along.size < 2:
        return []
    axes = "" if along.size == 3 else f"only {' and '.join('xyz'[k] for k in along)} move"
    found = [Finding("mass matrix: the same mass along x, y, z", free.disorder, limit, axes)]
    excess = inertia_excess(free.rigid) if along.size == 3 else None
    return found if excess is None else [*found, Finding(_EXCESS, excess, max(REALISABLE, limit))]


def order_that_shows(body: FEModel, whose: str) -> tuple[str, str]:
    """Part of the order of a mass that is shown where its pairs of nodes are, and a remark on the rest.

    Parameters
    ----------
    body : FEModel
        With its mass without masses at single nodes that are known.
    whose : str
        Nodes whose pairs show them, in words; empty for all.
    """
    if not _have_one_mass(body):
        rest = (
            "the masses of nodes differ by direction, some nodes lack rows along an axis, or rows of single nodes are "
            "in another order"
        )
        return f"order of {whose or 'nodes'}", f"; {rest}, so that nothing shows which row of a node is which"
    if not whose and _mirrored(body):
        rest = "the masses of nodes in the place of their mirror images would couple the same pairs"
        return "order or its mirror image", f"; {rest}"
    return f"order of {whose}" if whose else "order", ""


def _have_one_mass(body: FEModel) -> bool:
    """True if every node away from supports has one mass in all directions, and an inertia that resists turning.

    Under translation such a node has a momentum along it, and a moment of momentum across it. Rotation about the node
    gives a symmetric inertia. Rows of one node in each other's place do not.
    """
    if body.constrained is not None:
        # What holds a body in a plane is no support in it.
        along = np.isin(body.constrained.component, body.dofs.component)
        body = replace(body, constrained=body.constrained[np.flatnonzero(along)])
    assert body.nodes is not None
    ids = each_once(body.dofs.node[body.dofs.component > 0])
    rows = body.dofs.rows(ids[:, None], np.arange(1, 7)).reshape(-1, 6)
    turns = bool(body.M.diagonal()[body.dofs.component > 3].any())
    there = rows[:, :3] >= 0
    # A moment in a plane may be that of any mass.
    enough = there.all(axis=1) if turns else there.any(axis=1)
    seen = enough & away_from_supports(body, ids)
    ids, rows, there = ids[seen], rows[seen], there[seen]
    if not ids.size:
        return False
    at, least = body.nodes.index(ids), max(_SAME, _ROUNDINGS * body.rounding)
    frame = body.nodes.frame[at]

    def at_nodes(part: NDArray[np.int64], motions: slice) -> Array:
        """Momentum (k, 3, 3) of three rows of each node along basic axes, under three motions; zero without rows."""
        there = (part >= 0)[:, :, None]
        return np.asarray(np.einsum("kra,krm->kam", frame, np.where(there, body.rigid_momentum[part, motions], 0.0)))

    moving = at_nodes(rows[:, :3], slice(3))
    mass = np.trace(moving, axis1=1, axis2=2) / there.sum(axis=1)
    axes = np.einsum("kr,kra,krb->kab", there, frame, frame)
    off = abs(moving - mass[:, None, None] * axes).max(axis=(1, 2))
    if (off > least * abs(mass).max()).any():
        return False
    turning = rows[:, 3:]
    if not turns or not (turning >= 0).any():
        return True
    arm = cross_matrix(body.nodes.xyz[at] - body.nodes.xyz.mean(axis=0))
    moment = at_nodes(turning, slice(3))
    inertia = at_nodes(turning, slice(3, 6)) + moment @ arm
    size = float(abs(inertia).max())
    uneven = abs(inertia - inertia.transpose(0, 2, 1)).max()
    weight = np.linalg.eigvalsh((inertia + inertia.transpose(0, 2, 1)) / 2)
    whole = (turning >= 0).all(axis=1)
    skew = abs(moment + moment.transpose(0, 2, 1))[whole].max(initial=0.0)
    # Rotations of the neighbours, which may stand beside supports.
    spun = at_nodes(rows[:, :3], slice(3, 6)) + moving @ arm
    skew = max(skew, abs(spun + spun.transpose(0, 2, 1)).max())
    return bool(
        uneven <= least * size
        and weight.min() >= -least * size
        and skew <= least * max(float(abs(moment).max()), np.sqrt(size * float(abs(mass).max())))
    )


def _mirrored(body: FEModel) -> bool:
    """True if the masses of nodes in the place of their mirror images would couple the same pairs, and differ.

    Mirrors are across basic axes through the middle of the nodes, and their products; or the list of nodes is reversed.
    """
    assert body.nodes is not None
    rows = np.flatnonzero(body.dofs.component > 0)
    ids, of = np.unique(body.dofs.node[rows], return_inverse=True)
    xyz = body.nodes.xyz[body.nodes.index(ids)]
    images = [np.arange(ids.size)[::-1]]
    for signs in list(product((1.0, -1.0), repeat=3))[1:]:
        to = mirror_image(xyz, np.array(signs))
        images += [] if to is None else [to]
    every, least = np.arange(body.n), max(_SAME, _ROUNDINGS * body.rounding)
    for to in images:
        order = every.copy()
        order[rows] = body.dofs.rows(ids[to][of], body.dofs.component[rows])
        if (order < 0).any() or np.array_equal(order, every):
            continue
        if unchanged_in(body.M, order, least) or not _couples_the_same(body, order):
            continue
        # Moments of mass along the elements are turned round in the mirror.
        toward = moments_toward_neighbours(body, sp.csc_array(body.M[order][:, order]))
        if toward is None or not toward.doubtful:
            return True
    return False


def _couples_the_same(body: FEModel, order: NDArray[np.int64]) -> bool:
    """True if the mass in another order couples dofs that stiffness or mass couple; a few rows show most others."""
    few = np.arange(0, body.n, max(1, body.n // _FEW_ROWS))
    for some in (few, np.arange(body.n)):
        moved = sp.csc_array(body.M[:, order[some]][order])
        moved.eliminate_zeros()
        known = abs(body.K[:, some]) + abs(body.M[:, some])
        if np.count_nonzero(moved.multiply(known).data) < moved.nnz:
            return False
    return True
