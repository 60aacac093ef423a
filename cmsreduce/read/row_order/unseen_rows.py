"""Rows beside the ground whose order no force against rigid motion shows.

A node without force shows the order of the rows that it couples: with those of two nodes exchanged, it would resist
rotation. Solids of second order have nodes that couple only nodes beside the ground.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.read.row_order.mass_order import COUPLED, DIGITS
from cmsreduce.read.row_order.rigid_residual import RigidResidual

__all__ = ["unseen_rows"]

Indices = NDArray[np.int64]

# Relative to the forces of one of two nodes: an exchange that changes less does not show.
_SAME_FORCE = 1e-6
# Nodes that couple the same nodes without force, whose exchanges are tried.
_MOST_ALIKE = 40


def unseen_rows(body: FEModel, found: RigidResidual, held: Indices) -> Indices:
    """Rows of nodes beside the ground that could be those of another such node.

    Parameters
    ----------
    body : FEModel
        Body as read.
    found : RigidResidual
        Forces of its stiffness against rigid motion.
    held : (h,) int64
        Nodes beside the ground.
    """
    beside = np.flatnonzero(np.isin(body.dofs.node, held) & (body.dofs.component > 0))
    # One row with a force makes its node no witness.
    loud = np.isin(body.dofs.node, body.dofs.node[found.excess > 1]) | (body.dofs.component == 0)
    K, own = body.K[:, beside], np.sqrt(abs(body.K.diagonal()))
    column = np.repeat(np.arange(beside.size), np.diff(K.indptr))
    share = max(COUPLED, DIGITS * body.rounding)
    firm = ~loud[K.indices] & (abs(K.data) > share * own[K.indices] * own[beside[column]])
    seen = np.zeros(beside.size, dtype=bool)
    seen[column[firm]] = True
    witnesses = sp.csc_array((K.data[firm], (K.indices[firm], column[firm])), shape=K.shape)
    for group in _alike(body, witnesses, beside, seen):
        for one, other in combinations(group, 2) if len(group) <= _MOST_ALIKE else ():
            if not _shows(witnesses, found.shapes[beside], one, other):
                seen[one] = seen[other] = False
        if len(group) > _MOST_ALIKE:
            seen[np.concatenate(group)] = False
    return np.asarray(beside[~seen])


def _alike(body: FEModel, witnesses: sp.csc_array, beside: Indices, seen: NDArray[np.bool_]) -> list[list[Indices]]:
    """Nodes, by the positions of their rows, that have the same components and couple the same witnesses."""
    weight = np.random.default_rng(1).integers(0, 2**62, body.n)
    column = np.repeat(np.arange(beside.size), np.diff(witnesses.indptr))
    sums = np.zeros(beside.size, dtype=np.int64)
    np.add.at(sums, column, weight[witnesses.indices])
    order = np.lexsort((body.dofs.component[beside], body.dofs.node[beside]))
    groups: dict[tuple[tuple[int, ...], tuple[int, ...]], list[Indices]] = {}
    node = body.dofs.node[beside][order]
    for rows in np.split(order, np.flatnonzero(np.diff(node)) + 1) if order.size else ():
        if seen[rows].any():
            key = tuple(body.dofs.component[beside[rows]].tolist()), tuple(sums[rows].tolist())
            groups.setdefault(key, []).append(rows)
    return [group for group in groups.values() if len(group) > 1]


def _shows(witnesses: sp.csc_array, shapes: NDArray[np.float64], one: Indices, other: Indices) -> bool:
    """True if the exchange of two nodes changes the force of a witness under some rigid motion."""
    first, second = witnesses[:, one], witnesses[:, other]
    rows = np.unique(np.concatenate([first.indices, second.indices]))
    a, b = first[rows].toarray(), second[rows].toarray()
    change = (a - b) @ (shapes[other] - shapes[one])
    return bool(abs(change).max(initial=0.0) > _SAME_FORCE * (abs(a) @ abs(shapes[one])).max(initial=0.0))
