"""Shapes and lumped mass of a body at its nodes, along the basic axes."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.blocks import observed
from cmsreduce.mechanics import lumped_mass, untied_body
from cmsreduce.model import FEModel, Lumping, Nodes

__all__ = [
    "basic_shapes",
    "lumps_of_nodes",
]

# A displacement axis is perpendicular to a basic axis within this angle in radians: decks have 8 digits.
_PERPENDICULAR = 1e-6


def basic_shapes(
    body: FEModel,
    nodes: Nodes,
    Phi: NDArray[np.float64],
    chosen: NDArray[np.int64],
    motion: Literal["translation", "rotation"],
) -> NDArray[np.float64]:
    """Shapes at nodes along the basic axes, from rows along the displacement axes.

    Parameters
    ----------
    body : FEModel
        n dofs.
    nodes : Nodes
        Geometry of the body.
    Phi : (n, m) float64
        Shapes.
    chosen : (k,) int64
        Node ids, all of them in ``nodes``.
    motion : {"translation", "rotation"}
        The three components.

    Returns
    -------
    (k, 3, m) float64
        NaN along a basic axis in which the motion is not known. A constrained dof is known to be zero. But if all
        rotations of a node are constrained, it belongs to solid elements, and its slope is not known.
    """
    first = 1 if motion == "translation" else 4
    asked = np.repeat(chosen, 3), np.tile(np.arange(first, first + 3), chosen.size)
    recovery = body.recovery
    rows = recovery.dofs.rows(*asked).reshape(-1, 3)
    have = rows >= 0
    known = have.copy()
    if body.constrained is not None:
        held = body.constrained.rows(*asked).reshape(-1, 3) >= 0
        known |= held if motion == "translation" else held & have.any(axis=1, keepdims=True)
    axes = nodes.frame[nodes.index(chosen)]
    along = np.where(have[..., None], observed(recovery.T[rows.ravel()], Phi).reshape(*rows.shape, Phi.shape[1]), 0.0)
    shapes = np.asarray(np.einsum("kca,kcm->kam", axes, along))
    # An unknown motion along an axis is unknown along every basic axis that is not perpendicular to it.
    unknown = (abs(axes) > _PERPENDICULAR) & ~known[..., None]
    shapes[unknown.any(axis=1)] = np.nan
    return shapes


def lumps_of_nodes(
    body: FEModel, chosen: NDArray[np.int64], lumping: Lumping = "diagonal"
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Point mass and inertia of nodes, along the basic axes.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    chosen : (k,) int64
        Node ids.
    lumping : {"diagonal", "row-sum"}
        Diagonal entries scaled to the mass of the body, never negative; or sums of rows, which keep the centre of mass.

    Returns
    -------
    mass : (k,) float64
        0 for a point to which nodes are tied, because their mass stays at them, and for a node that cannot move.
    inertia : (k, 3, 3) float64
        Inertia about the node itself.

    Raises
    ------
    DofMapError
        If the body has no geometry.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass cannot be lumped at its nodes")
    untied, _ = untied_body(body)
    M = lumped_mass(untied, lumping)
    axes = body.nodes.frame[body.nodes.index(chosen)]
    rows = untied.dofs.rows(np.repeat(chosen, 6), np.tile(np.arange(1, 7), chosen.size)).reshape(-1, 2, 3)
    along = np.where(rows[:, 0] >= 0, M.diagonal()[rows[:, 0]], 0.0)
    turning = rows[:, 1]
    known = (turning >= 0)[:, :, None] & (turning >= 0)[:, None, :]
    entries = M[np.repeat(turning, 3, axis=1).ravel(), np.tile(turning, (1, 3)).ravel()]
    J = np.where(known, np.asarray(entries).reshape(-1, 3, 3), 0.0)
    return along.max(axis=1, initial=0.0), np.einsum("kca,kcd,kdb->kab", axes, J, axes)
