"""Nodes whose rows contradict the geometry; the matrix itself shows their true places and axes.

All other nodes are moved rigidly and the suspects are left free. If the matrix is sound, the suspects follow rigidly
too, because a rigid motion is the only state without force. Their displacements show the true axes and place of each.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read.row_order.rigid_residual import RigidResidual

__all__ = ["mislabelled_nodes"]

# The displacements of the suspects are solved for with a dense matrix: 1500 dofs take 18 MB and a second.
_MOST_DOFS = 1500
# The error of the solution grows with the condition of the suspects' stiffness; a wrong node differs by far more.
_TRUE = 1e-4
# Forces that remain when the suspects are free, relative to the forces before.
_EXPLAINED = 1e-5
_NAMED = 5


def mislabelled_nodes(body: FEModel, nodes: Nodes, found: RigidResidual, suspects: NDArray[np.int64]) -> str | None:
    """Describe the nodes whose rows belong to another node, to other axes or to another place.

    Parameters
    ----------
    body : FEModel
        Body whose rigid motions leave forces; examined only if it has all six motions.
    nodes : Nodes
        Its geometry.
    found : RigidResidual
        The forces.
    suspects : (k,) int64
        Nodes with forces.

    Returns
    -------
    str or None
        None if other labels of the suspects do not explain the forces.
    """
    free = np.isin(body.dofs.node, suspects)
    if not np.array_equal(found.motions, np.eye(6)) or free.all() or free.sum() > _MOST_DOFS:
        return None
    moved = _follow(body, found, free)
    if moved is None:
        return None
    wrong = []
    for node in suspects:
        true = _true_node(body.dofs, found, moved, int(node))
        at = int(nodes.index(int(node))[0])
        if true is None:
            return None
        arm, axes = true
        same_axes = np.abs(axes - nodes.frame[at]).max() < _TRUE
        same_place = np.linalg.norm(arm - (nodes.xyz[at] - found.centre)) < _TRUE * found.length
        if not (same_axes and same_place):
            wrong.append(_difference(int(node), arm, axes, nodes, found))
    if not wrong:
        return None
    more = f", and {len(wrong) - _NAMED} more nodes" if len(wrong) > _NAMED else ""
    return (
        f"{'; '.join(wrong[:_NAMED])}{more}. All other rows are in order. Correct the geometry, or give the order of "
        "the rows as a list of node.component under `rows:`"
    )


def _follow(body: FEModel, found: RigidResidual, free: NDArray[np.bool_]) -> NDArray[np.float64] | None:
    """Displacements of all dofs if the free ones follow the rigid motion of the others; None if forces remain."""
    K = body.K[free]
    rest = ~free
    inner = K[:, free].toarray()
    load = -np.asarray(K[:, rest] @ found.shapes[rest])
    moved = found.shapes.copy()
    # The suspects may have dofs without stiffness, so the smallest solution is taken.
    moved[free] = np.linalg.lstsq(inner, load, rcond=None)[0]
    left = np.abs(np.asarray(body.K @ moved)).max(axis=0)
    return moved if (left <= _EXPLAINED * np.abs(found.force).max()).all() else None


def _true_node(
    dofs: DofTable, found: RigidResidual, moved: NDArray[np.float64], node: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Arm from the centre and axes of a node, by its displacements under the rigid motions; None if there are none."""
    rows = dofs.rows(node, [1, 2, 3])
    if (rows < 0).any():
        return None
    axes, turned = moved[rows, :3], moved[rows, 3:] * found.length
    if np.abs(axes @ axes.T - np.eye(3)).max() > _TRUE:
        return None
    # Turning by w moves the node by w x arm, whose matrix is minus that of arm x w.
    spin = axes.T @ turned
    arm = np.array([spin[1, 2] - spin[2, 1], spin[2, 0] - spin[0, 2], spin[0, 1] - spin[1, 0]]) / 2
    if np.abs(spin + spin.T).max() > _TRUE * found.length:
        return None
    return arm, axes


def _difference(
    id: int, arm: NDArray[np.float64], axes: NDArray[np.float64], nodes: Nodes, found: RigidResidual
) -> str:
    """Difference between the matrices and the geometry at one node."""
    at = int(nodes.index(id)[0])
    away = np.linalg.norm(nodes.xyz - found.centre - arm, axis=1)
    nearest = int(away.argmin())
    if away[at] >= _TRUE * found.length:
        if away[nearest] < _TRUE * found.length:
            return f"the rows labelled node {id} are those of node {nodes.id[nearest]} (rows are shuffled)"
        place = ", ".join(f"{x:.6g}" for x in arm + found.centre)
        given = ", ".join(f"{x:.6g}" for x in nodes.xyz[at])
        return f"node {id} is at ({place}) in the matrices, at ({given}) in the geometry"
    own = nodes.frame[at]
    if np.linalg.det(axes @ own.T) < 0:
        return f"the rows of node {id} are left-handed: components are exchanged, or one has the other sign"
    if np.abs(axes - np.eye(3)).max() < _TRUE:
        return f"the rows of node {id} are along the basic axes, not along its displacement frame (CD)"
    angle = np.degrees(np.arccos(np.clip((np.trace(axes @ own.T) - 1) / 2, -1, 1)))
    where = "the basic axes" if np.abs(own - np.eye(3)).max() < _TRUE else "its displacement frame in the geometry"
    return (
        f"the rows of node {id} are along axes turned by {angle:.4g} degrees from {where}: its displacement frame "
        "(CD) is missing or wrong"
    )
