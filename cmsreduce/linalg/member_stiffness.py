"""Elastic stiffness of straight bars and rods at their ends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model import Members, Nodes, cross_matrix

__all__ = ["member_stiffness"]

Array = NDArray[np.float64]

# Sine of the angle between a bar and its orientation vector, below which the vector tells no plane.
_PARALLEL = 1e-6


def member_stiffness(members: Members, nodes: Nodes) -> Array:
    """Stiffness of each bar (b, 12, 12) for translations and rotations of its two ends, basic axes.

    Parameters
    ----------
    members : Members
        b bars.
    nodes : Nodes
        Their nodes.

    Raises
    ------
    MatrixError
        If a bar has no length, or its orientation vector lies along it.

    Notes
    -----
    The end b of a bar held at a deflects by the flexibility of bending, shear, torsion and stretch; its inverse, with
    the stiff motion of b under that of a, is the stiffness. Released motions are condensed.
    """
    places = nodes.xyz[nodes.index(members.node.ravel())].reshape(-1, 2, 3) + members.offset
    out = np.zeros((members.EA.size, 12, 12))
    for k, (start, end) in enumerate(places):
        axes, L = _axes(start, end, members.up[k], bool(members.EI[k].any()))
        at_end = np.zeros((6, 6))
        at_end[0, 0], at_end[3, 3] = members.EA[k] / L, members.GJ[k] / L
        at_end += _bending(members.EI[k], members.shear[k], L)
        carried = np.hstack([-np.eye(6), np.eye(6)])
        carried[:3, 3:6] = cross_matrix([L, 0.0, 0.0])
        own = _released(carried.T @ at_end @ carried, members.released[k])
        turn = np.kron(np.eye(4), axes)
        out[k] = turn.T @ own @ turn
    return out


def _axes(start: Array, end: Array, up: Array, bends: bool) -> tuple[Array, float]:
    """Axes of a bar as rows, its first plane of bending x y, and its length."""
    L = float(np.linalg.norm(end - start))
    if L == 0:
        raise MatrixError(f"a bar at {start} has no length")
    x = (end - start) / L
    if not bends:
        up = np.eye(3)[int(np.abs(x).argmin())]
    z = np.cross(x, up)
    size = float(np.linalg.norm(z))
    if size <= _PARALLEL * float(np.linalg.norm(up)):
        raise MatrixError(f"the orientation vector of the bar from {start} to {end} lies along it")
    z /= size
    return np.array([x, np.cross(z, x), z]), L


def _bending(EI: Array, shear: Array, L: float) -> Array:
    """Stiffness (6, 6) of the end of a bar held at the other one, in both planes, own axes."""
    K = np.zeros((6, 6))
    planes = np.flatnonzero(EI.diagonal() > 0)
    if not planes.size:
        return K
    C, S = np.linalg.inv(EI[np.ix_(planes, planes)]), np.diag(shear[planes])
    flexibility = np.block([[C * L**3 / 3 + S * L, C * L**2 / 2], [C * L**2 / 2, C * L]])
    # Deflections y, z; slopes dy/dx = rz and dz/dx = -ry.
    at = np.concatenate([np.array([1, 2])[planes], np.array([5, 4])[planes]])
    sign = np.concatenate([np.ones(planes.size), np.array([1.0, -1.0])[planes]])
    K[np.ix_(at, at)] = np.linalg.inv(flexibility) * np.outer(sign, sign)
    return K


def _released(K: Array, free: NDArray[np.bool_]) -> Array:
    if not free.any():
        return K
    return K - K[:, free] @ np.linalg.pinv(K[np.ix_(free, free)], hermitian=True) @ K[free]
