"""Constrained dofs of a body, which have no rows, and supports along axes of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.formats import Geometry

__all__ = ["constrained_dofs", "with_turned_supports"]

# A support that is not along the axes of its node has a node of its own, whose number is so much larger.
_TURNED = 10**14


def constrained_dofs(geometry: Geometry, dofs: DofTable) -> DofTable | None:
    """Constrained dofs without rows; None if there are none.

    Parameters
    ----------
    geometry : Geometry
        Geometry that names the constrained dofs.
    dofs : DofTable
        Rows of the matrices. A constrained dof that has a row is free.

    Notes
    -----
    A support along axes of its own takes one of the rows that its node has along basic axes. It belongs to a node of
    `with_turned_supports`.
    """
    table = geometry.constrained
    if table is None:
        return None
    turned = np.isin(table.node, list(geometry.turned))
    first = np.where(table.component > 3, 4, 1)
    along = np.where(turned[:, None], first[:, None] + np.arange(3), table.component[:, None])
    without_row = np.flatnonzero((dofs.rows(table.node[:, None], along).reshape(-1, 3) < 0).any(axis=1))
    if not without_row.size:
        return None
    return DofTable(table.node + _TURNED * turned, table.component)[without_row]


def with_turned_supports(nodes: Nodes, held: DofTable, turned: Mapping[int, NDArray[np.float64]]) -> Nodes:
    """Nodes and, at the same places, those of supports along axes of their own.

    Parameters
    ----------
    nodes : Nodes
        Nodes of the geometry.
    held : DofTable
        Constrained dofs of `constrained_dofs`.
    turned : mapping of int to (3, 3) float64
        Axes, as rows, of the supports by node.
    """
    made = np.unique(held.node[held.node >= _TURNED])
    if not made.size:
        return nodes
    own = made - _TURNED
    return replace(
        nodes,
        id=np.append(nodes.id, made),
        xyz=np.vstack([nodes.xyz, nodes.xyz[nodes.index(own)]]),
        frame=np.vstack([nodes.frame, [turned[int(node)] for node in own]]),
    )
