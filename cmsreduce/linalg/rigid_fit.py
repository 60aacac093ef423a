"""The rigid motion of some rows of a body that fits their displacements best."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model import FEModel, rigid_body_shapes

__all__ = ["best_fit"]

# Rigid motions that some rows show less than this share of, relative to the largest, they cannot tell.
_SHOWN = 1e-8


def best_fit(body: FEModel, rows: NDArray[np.int64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rigid motion of an interface about its first node that fits its dofs best.

    Parameters
    ----------
    body : FEModel
        With geometry.
    rows : (i,) int64
        Rows of the interface.
    position : (p, 3) float64
        Its nodes.

    Returns
    -------
    (6, i) float64
        From displacements of the rows to translations and rotations along the basic axes, in the least-squares sense;
        motions that the rows do not show are zero.

    Raises
    ------
    SceneError
        If the body has no geometry.
    """
    if body.nodes is None:
        raise SceneError(f"component '{body.name}' has no geometry, so the rigid motion of an interface is not known")
    # Rotations count by what they move at the edge of the interface, so that units do not matter.
    edge = float(np.linalg.norm(position - position[0], axis=1).max()) or 1.0
    row = np.where(np.isin(body.dofs.component[rows], (4, 5, 6)), edge, 1.0)
    column = np.array([1.0, 1.0, 1.0, edge, edge, edge])
    R = rigid_body_shapes(body.dofs, body.nodes, position[0])[rows]
    return np.asarray(la.pinv(row[:, None] * R / column, rtol=_SHOWN) * row / column[:, None])
