"""Mass of a finite-element body lumped at its nodes, for codes that integrate over nodes themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.lumped_mass import lumped_mass
from cmsreduce.linalg.untied import untied_body
from cmsreduce.model import FEModel, Lumping

__all__ = ["lumps_of_nodes"]


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
        0 of a point that nodes are tied to, whose mass stays at these, and of a node that does not move.
    inertia : (k, 3, 3) float64
        About the node itself.

    Raises
    ------
    DofMapError
        If the body has no geometry.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass cannot be gathered at its nodes")
    whole, _ = untied_body(body)
    M = lumped_mass(whole, lumping)
    axes = body.nodes.frame[body.nodes.index(chosen)]
    rows = whole.dofs.rows(np.repeat(chosen, 6), np.tile(np.arange(1, 7), chosen.size)).reshape(-1, 2, 3)
    along = np.where(rows[:, 0] >= 0, M.diagonal()[rows[:, 0]], 0.0)
    turning = rows[:, 1]
    known = (turning >= 0)[:, :, None] & (turning >= 0)[:, None, :]
    entries = M[np.repeat(turning, 3, axis=1).ravel(), np.tile(turning, (1, 3)).ravel()]
    J = np.where(known, np.asarray(entries).reshape(-1, 3, 3), 0.0)
    return along.max(axis=1, initial=0.0), np.einsum("kca,kcd,kdb->kab", axes, J, axes)
