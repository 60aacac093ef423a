"""Inertia forces of a body whose frame accelerates, turns faster, or spins (theory section 8)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.modal_integrals import MassBlocks, nodal_motion
from cmsreduce.model import FEModel, rigid_body_shapes

__all__ = ["inertia_loads"]

Array = NDArray[np.float64]

# Components of a vector product: (a x b)_j = CROSS_jlm a_l b_m.
_CROSS = np.zeros((3, 3, 3))
_CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
_CROSS[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0
# Products of angular velocities: xx yy zz xy yz xz.
_SQUARES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))


def inertia_loads(body: FEModel, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Inertia forces on a body at rest in a frame that moves by one unit, frame axes basic.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    origin : (3,) array_like
        Point of the body that the accelerations are of, and that the rotations turn about, in basic.

    Returns
    -------
    (n, 12) float64
        Generalised forces on the rows: minus M R of three accelerations and three angular accelerations; then for
        the products xx yy zz xy yz xz of angular velocities, the centrifugal forces.

    Raises
    ------
    DofMapError
        If the body has no geometry.

    Notes
    -----
    A point at r of a frame of angular velocity w has the acceleration W r, W = w w^T - w.w 1, and the force on the
    shape phi is - int phi . W r dm: minus W_ij int r_i phi_j dm, of which W, being symmetric, asks for the symmetric
    part. The integrals are those of `modal_integrals`, so that the centrifugal force is the derivative of the inertia
    that a floating-frame code is given; rigid lumps count with offset and inertia.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so nothing says how inertia acts on it")
    origin = np.asarray(origin, dtype=np.float64)
    steady = -(body.M @ rigid_body_shapes(body.dofs, body.nodes, origin))
    W = _position_loads(body, origin)
    centrifugal = []
    for a, b in _SQUARES:
        along = np.einsum("iin->n", W) - W[a, a] if a == b else -(W[a, b] + W[b, a])
        centrifugal.append(along)
    return np.column_stack([steady, *centrifugal])


def _position_loads(body: FEModel, origin: Array) -> Array:
    """Rows w with w @ x = int r_i u_j dm of the motion u that x gives (3, 3, n); right in what is symmetric."""
    assert body.nodes is not None
    to_axes = nodal_motion(body, np.eye(3))
    at = np.unique(body.dofs.node[body.dofs.component > 0])
    r, N = body.nodes.xyz[body.nodes.index(at)] - origin, at.size
    pairs = MassBlocks((to_axes @ body.M @ to_axes.T).tocsr(), N)
    u, t = np.zeros((3, 3, 3, N)), np.zeros((3, 3, 3, N))
    for i in range(3):
        a, b = (i + 1) % 3, (i + 2) % 3
        arm = pairs.part(a, b) - pairs.part(b, a)
        offset = np.asarray(arm.sum(axis=1)).ravel() / 2
        for j in range(3):
            there = np.zeros((3, N))
            there[j] = r[:, i]
            u[i, j] += (pairs.translation.T @ there.ravel()).reshape(3, N)
            t[i, j] += (pairs.coupling.T @ there.ravel()).reshape(3, N)
            u[i, j, j] += offset
        for m in range(3):
            spread = np.asarray(pairs.spread[i][m].sum(axis=0)).ravel()
            t[i] += _CROSS[:, :, m, None] * spread
    rows = np.concatenate([u, t], axis=2).reshape(9, 6 * N)
    return np.asarray((to_axes.T @ rows.T).T).reshape(3, 3, body.n)
