"""Rotations that nothing resists, as those about the normal of flat plates, and matrices that leave them out.

A program holds one component of such a rotation. Where its axis is none of the node, rigid motion of the body then
turns the other two by what is left of it: they lack what the component held would turn about the axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import DofTable
from cmsreduce.read.labelled_matrix import LabelledMatrix

__all__ = ["IdleTurns", "with_idle_turns"]

# Of the axis of a rotation: a component less than this is round-off of coordinates with all their digits.
_ALONG = 1e-12


@dataclass(frozen=True, eq=False)
class IdleTurns:
    """Rotations of nodes that nothing resists, each with the component that a program takes out of its matrices.

    Parameters
    ----------
    held : DofTable
        Component held (k), 4..6, of each node.
    direction : (k, 3) float64
        Axis of the rotation along the axes of the node.
    """

    held: DofTable
    direction: NDArray[np.float64]


def with_idle_turns(
    table: DofTable, matrices: Sequence[LabelledMatrix], idle: IdleTurns
) -> tuple[DofTable, list[LabelledMatrix]]:
    """Matrices with the components held, where the axis is none of the node; nothing resists the rotation in them.

    Parameters
    ----------
    table : DofTable
        Their n rows.
    matrices : sequence of LabelledMatrix
        Matrices (n, n) on these rows.
    idle : IdleTurns
        Rotations.

    Returns
    -------
    table : DofTable
        The n rows, and m of components held.
    matrices : list of LabelledMatrix
        (n + m, n + m), of the same energy for every motion.
    """
    node, component, every = idle.held.node, idle.held.component, np.array([4, 5, 6])
    share = idle.direction / idle.direction[np.arange(node.size), component - 4, None]
    share = np.where((every == component[:, None]) | (abs(share) <= _ALONG), 0.0, share)
    rows = table.rows(node[:, None], every).reshape(-1, 3)
    beside = ((rows >= 0) | (share == 0)).all(axis=1) & share.any(axis=1)
    lost = np.flatnonzero(beside & (table.rows(node, component) < 0))
    if not lost.size:
        return table, [*matrices]
    at, turned = np.nonzero(share[lost])
    more = sp.csr_array((-share[lost[at], turned], (rows[lost[at], turned], at)), shape=(len(table), lost.size))
    T = sp.csr_array(sp.hstack([sp.eye_array(len(table)), more]))
    whole = table.joined(idle.held[lost])
    return whole, [replace(one, A=sp.csc_array(T.T @ one.A @ T), dofs=whole) for one in matrices]
