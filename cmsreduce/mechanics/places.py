"""Coordinates of nodes from the stiffness matrix, which knows them to its own digits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.model import FEModel, Nodes, rigid_body_shapes

__all__ = ["places_by_stiffness"]

Array = NDArray[np.float64]

# Nodes that determine the motions; more would add no digits.
_ENOUGH = 2000
# Weight of the printed coordinates against the stiffness: they only decide what the stiffness leaves open, which is
# the origin and the scale.
_PRINTED = 1e-6
# Coordinates move by their rounding at most; the nodes that hold the body add theirs to all others.
_MOVED = 30.0
# Where coordinates are off by d, a rotation of a body of length L strains its ties by d / L of its motion. The energy
# goes with the square: it is below half a rounding of its terms. A tie of size h gets (d / h)^2 of its stiffness, less
# than a factor leaves.
_EXACT, _EXACT_TIE = 2.0**-27, 1e-7


def places_by_stiffness(body: FEModel) -> FEModel:
    """A free body with coordinates as exact as its stiffness.

    Rigid motion costs no force at the true coordinates. A tie at coordinates of six digits would hold the body.

    Parameters
    ----------
    body : FEModel
        Free in six motions; its rows are proven.

    Returns
    -------
    FEModel
        The same body if its coordinates are exact enough for ties of its interfaces, or if K has further motions
        without force.

    Notes
    -----
    K gives six motions N without force, which are near the rigid motions R of the printed coordinates. The rotations
    W = N C must be W u = u x r at every node, so that the 3 x 3 block of a node is skew. These equations are linear in
    C. The blocks then show r.
    """
    nodes = body.nodes
    if nodes is None or not nodes.xyz_rounding:
        return body
    moving = (body.dofs.component > 0) & (body.dofs.component <= 3)
    ids, count = np.unique(body.dofs.node[moving], return_counts=True)
    turned = np.abs(nodes.frame - np.eye(3)).max(axis=(1, 2)) > 0
    ids = ids[(count == 3) & ~turned[nodes.index(ids)]]
    rows = np.column_stack([body.dofs.rows(ids, component) for component in (1, 2, 3)])
    centre = nodes.xyz[nodes.index(ids)].mean(axis=0) if ids.size else np.zeros(3)
    length = float(np.linalg.norm(nodes.xyz[nodes.index(ids)] - centre, axis=1).max(initial=0.0))
    exact = min(_EXACT * length, _EXACT_TIE * _least_size(body, nodes))
    if ids.size < 3 or not length or nodes.xyz_rounding <= exact:
        return body
    R = rigid_body_shapes(body.dofs, nodes, centre) / np.repeat([1.0, length], 3)
    N = _without_force(body.K, R)
    if N is None:
        return body
    C = _rotations(N[rows], R[rows][:, :, 3:])
    W = N[rows] @ C
    # W[a, k] is the component a of e_k x r.
    r = np.stack([W[:, 1, 2] - W[:, 2, 1], W[:, 2, 0] - W[:, 0, 2], W[:, 0, 1] - W[:, 1, 0]], axis=1) / 2
    xyz = nodes.xyz.copy()
    xyz[nodes.index(ids)] = centre + length * r
    if np.abs(xyz - nodes.xyz).max() > _MOVED * nodes.xyz_rounding:
        return body
    return replace(body, nodes=Nodes(nodes.id, xyz, nodes.frame, nodes.xyz_rounding, nodes.frame_rounding))


def _least_size(body: FEModel, nodes: Nodes) -> float:
    """Distance of the centre of an interface from its farthest node, of the smallest interface of several nodes."""
    places = [nodes.xyz[nodes.index(face.node)] for face in body.interfaces.values() if face.node.size > 1]
    return min((float(np.linalg.norm(at - at.mean(axis=0), axis=1).max()) for at in places), default=0.0)


def _without_force(K: sp.csc_array, R: Array) -> Array | None:
    """Six motions without force that agree with R (n, 6) at six rows; None if K does not resist all others."""
    _, _, order = la.qr(R.T, mode="economic", pivoting=True)
    others = np.sort(order[R.shape[1] :])
    try:
        held = factorise(sp.csc_array(K[others][:, others]), what="the stiffness held at six dofs")
    except NotPositiveDefiniteError:
        return None
    N = R.copy()
    N[others] -= held(np.asarray(K @ R)[others])
    return N


def _rotations(N: Array, R: Array) -> Array:
    """C (6, 3) for which the blocks N C (m, 3, 3) are skew, and near R (m, 3, 3)."""
    some = slice(None, None, max(1, len(N) // _ENOUGH))
    N, R = N[some], R[some]
    equations, sides = [], []
    for a in range(3):
        for b in range(a, 3):
            rows = np.zeros((len(N), 3, 6))
            rows[:, b] += N[:, a]
            rows[:, a] += N[:, b]
            equations.append(rows.reshape(len(N), 18))
            sides.append(np.zeros(len(N)))
            for k, axis in ((b, a), (a, b)):
                rows = np.zeros((len(N), 3, 6))
                rows[:, k] = _PRINTED * N[:, axis]
                equations.append(rows.reshape(len(N), 18))
                sides.append(_PRINTED * R[:, axis, k])
    C, *_ = np.linalg.lstsq(np.vstack(equations), np.concatenate(sides))
    return np.asarray(C.reshape(3, 6).T)
