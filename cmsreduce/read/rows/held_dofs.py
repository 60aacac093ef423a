"""Constrained dofs of a body, which have no rows, and supports along axes of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import DOUBLE, SCALAR, DofTable, Nodes
from cmsreduce.read.formats import Geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix

__all__ = ["constrained_dofs", "with_turned_supports", "without_support_rows"]

# A support that is not along the axes of its node has a node of its own, whose number is so much larger.
_TURNED = 10**14
# Of a number: the same one printed with few digits.
_ROUNDED = 1e-6


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


def without_support_rows(
    table: DofTable, matrices: Sequence[LabelledMatrix], inner: DofTable | None
) -> tuple[DofTable, list[LabelledMatrix], DofTable]:
    """Matrices without the rows of supports, which some programs leave in as an equation of their own.

    Parameters
    ----------
    table : DofTable
        Their rows.
    matrices : sequence of LabelledMatrix
        Stiffness and mass, and damping if there is one.
    inner : DofTable, optional
        Generalised coordinates.

    Returns
    -------
    table, matrices
        Without those rows.
    held : DofTable
        Dofs of the supports.

    Notes
    -----
    Such a row has nothing but one number on the diagonal of the stiffness, the same for all of them, beside which the
    others are rounding; its column may hold others. Where it is 1, or so large that nothing else moves the dof, the
    mass may be as it was. Any other number may be a spring to the ground, unless its mass is 1 or nothing. Left in,
    rows with 1 and 1 are motions of 0.16 Hz.
    """
    K = matrices[0].A
    diagonal = K.diagonal()
    # Some programs leave the columns, or the rows, as they are.
    size = sp.csc_array((np.abs(K.data), K.indices, K.indptr), K.shape)
    beside = np.minimum(size.sum(axis=0), size.sum(axis=1)) - abs(diagonal)
    alone = (table.component != SCALAR) & (diagonal > 0) & (beside <= DOUBLE * diagonal)
    if inner is not None:
        alone &= inner.rows(table.node, table.component) < 0
    sure = (diagonal == 1) | (DOUBLE * diagonal >= diagonal[~alone].max(initial=0.0))
    for one in matrices[1:]:
        own = one.A.diagonal()
        alone &= sure | (((own == 0) | (own == 1)) & (_fewest_entries(one.A) == (own != 0)))
    cut = np.flatnonzero(alone)
    k = diagonal[cut]
    if not 0 < 2 * cut.size < len(table) or np.ptp(k) > _ROUNDED * k.max():
        return table, [*matrices], table[cut[:0]]
    kept = np.flatnonzero(~alone)
    rest = table[kept]
    return rest, [replace(one, A=one.A[kept][:, kept], dofs=rest) for one in matrices], table[cut]


def _fewest_entries(A: sp.csc_array) -> NDArray[np.int64]:
    """Entries of each row or of each column, where these are fewer (n,)."""
    return np.minimum(np.diff(A.indptr), np.bincount(A.indices, minlength=A.shape[0]))
