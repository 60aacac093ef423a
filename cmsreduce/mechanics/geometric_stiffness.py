"""Geometric stiffness of a body of bars under unit loads, and inertia forces of a moving frame (theory section 8)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError, SceneError, SingularInterfaceError
from cmsreduce.linalg.blocks import congruence
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.mechanics.bars import BarStiffness, known_motion
from cmsreduce.mechanics.lumped_mass import moves_generalised
from cmsreduce.mechanics.modal_integrals import CROSS, MassBlocks, nodal_motion
from cmsreduce.mechanics.turning_lumps import turning_lumps
from cmsreduce.model import (
    INERTIA_LOADS,
    SQUARES,
    UNDETERMINED,
    Bars,
    FEModel,
    GeometricStiffness,
    ModalStiffening,
    Recovery,
    UnitLoad,
    rigid_body_shapes,
)

__all__ = [
    "bars_stiffness",
    "inertia_loads",
    "modal_stiffening",
    "unit_forces",
]

Array = NDArray[np.float64]

BARS = "bars of the deck"
"""Source of a computed matrix."""

# Axes of the products of angular velocities.
_SQUARES = [("xyz".index(axes[0]), "xyz".index(axes[1])) for axes in SQUARES]


def inertia_loads(body: FEModel, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Array:
    """Inertia forces on a body at rest in a frame with unit accelerations and angular velocities, along basic axes.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    origin : (3,) array_like
        Point of the acceleration, and centre of the rotations, in basic.

    Returns
    -------
    (n, 12) float64
        Generalised forces on the rows: -M R of three accelerations and three angular accelerations; then the
        centrifugal forces of the products xx yy zz xy yz xz of angular velocities.

    Raises
    ------
    DofMapError
        If the body has no geometry, or generalised coordinates have mass.

    Notes
    -----
    A point at r of a frame of angular velocity w has the acceleration W r, W = w w^T - w.w 1, and the force on the
    shape phi is - int phi . W r dm = - W_ij int r_i phi_j dm. Only the symmetric part of the integral matters, because
    W is symmetric. The integrals are the same as in `modal_integrals`, so the centrifugal force is the derivative of
    the inertia in a floating-frame code; rigid lumps count with offset and inertia.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its inertia forces are unknown")
    if moves_generalised(body):
        raise DofMapError(f"body '{body.name}': {UNDETERMINED}, so its centrifugal forces are unknown")
    origin = np.asarray(origin, dtype=np.float64)
    steady = -(body.M @ rigid_body_shapes(body.dofs, body.nodes, origin))
    W = _position_loads(body, origin)
    centrifugal = []
    for a, b in _SQUARES:
        along = np.einsum("iin->n", W) - W[a, a] if a == b else -(W[a, b] + W[b, a])
        centrifugal.append(along)
    return np.column_stack([steady, *centrifugal])


def _position_loads(body: FEModel, origin: Array) -> Array:
    """Rows w with w @ x = int r_i u_j dm, u the motion of x (3, 3, n); only the symmetric part is exact."""
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
            t[i] += CROSS[:, :, m, None] * spread
    rows = np.concatenate([u, t], axis=2).reshape(9, 6 * N)
    return np.asarray((to_axes.T @ rows.T).T).reshape(3, 3, body.n)


def bars_stiffness(
    body: FEModel,
    bars: Bars,
    loads: Sequence[UnitLoad] = INERTIA_LOADS,
    *,
    held: NDArray[np.int64],
    origin: Array | None = None,
    holding: str = "",
    hidden: Recovery | None = None,
    points: Array | None = None,
) -> GeometricStiffness:
    """Geometric stiffness of a body of bars and beams for each of some unit loads.

    Parameters
    ----------
    body : FEModel
        n dofs; its other elements add no geometric stiffness.
    bars : Bars
        Bars of the body, in its units.
    loads : sequence of UnitLoad
        Loads; forces and moments act at a node.
    held : (h,) int64
        Rows at rest while the loads act, as in the moving frame; none for a body with supports.
    origin : (3,) float64, optional
        Centre of rotation of the frame, in basic; the origin if absent.
    holding : str
        Support of these rows, in words.
    hidden : Recovery, optional
        Motion of dofs of the bars without rows.
    points : (N, 6, 6) float64, optional
        Mass matrices of the point masses at each node, along basic axes: they turn under inertia forces.

    Raises
    ------
    SingularInterfaceError
        If the body can still move without strain when these rows are held.

    Notes
    -----
    Stress and geometric stiffness are linear in the load: u = K^-1 f with the rows held gives the force along each bar,
    and this force gives its geometric stiffness. The stress of balanced forces does not depend on the support, if the
    support just prevents rigid motion.
    """
    about = np.zeros(3) if origin is None else np.asarray(origin, dtype=np.float64)
    stiffness = BarStiffness(body, bars, hidden)
    tension = _tensions(body, stiffness, unit_forces(body, loads, about), held)
    matrices = [stiffness.stiffness(column) for column in tension.T]
    if points is not None and points.any():
        lumps = turning_lumps(body, points, known_motion(body, hidden), loads, about)
        matrices = [sp.csc_array(own + lump) for own, lump in zip(matrices, lumps, strict=True)]
    return GeometricStiffness(tuple(loads), tuple(matrices), (BARS,) * len(matrices), about, holding)


def modal_stiffening(stiffening: GeometricStiffness, Phi: Array) -> ModalStiffening:
    """Geometric stiffness in modes Phi (n, m): Phi^T K_l Phi of each unit load l."""
    K = [congruence(A, Phi) for A in stiffening.matrices]
    return ModalStiffening(stiffening.loads, np.array(K).reshape(len(K), Phi.shape[1], Phi.shape[1]), stiffening.origin)


def unit_forces(body: FEModel, loads: Sequence[UnitLoad], origin: Array) -> Array:
    """Generalised forces of unit loads on the rows (n, l), rotations about ``origin``.

    Raises
    ------
    SceneError
        If a force acts on a node that cannot move along it.
    """
    inertia = [load for load in loads if not load.at]
    moving = inertia_loads(body, origin) if inertia else np.zeros((body.n, 0))
    columns = [_at_node(body, load) if load.at else moving[:, INERTIA_LOADS.index(load)] for load in loads]
    return np.column_stack(columns) if columns else np.zeros((body.n, 0))


def _at_node(body: FEModel, load: UnitLoad) -> Array:
    """A unit force or moment along a basic axis, on the rows (n,)."""
    node, first = int(load.at), 1 if load.kind == "force" else 4
    at = -1 if body.nodes is None else int(body.nodes.index(node)[0])
    rows = body.recovery.dofs.rows(node, np.arange(first, first + 3))
    axis = "xyz".index(load.axes)
    if at < 0 or body.nodes is None or (rows < 0).all():
        raise SceneError(f"body '{body.name}': '{load.label}' acts on a node that has no such motion")
    there = rows >= 0
    return np.asarray(body.recovery.T[rows[there]].T @ body.nodes.frame[at][there, axis])


def _tensions(body: FEModel, stiffness: BarStiffness, forces: Array, held: NDArray[np.int64]) -> Array:
    free = np.setdiff1d(np.arange(body.n), held)
    u = np.zeros_like(forces)
    K = sp.csc_array(body.K[free][:, free])
    try:
        u[free] = factorise(K, what=f"the stiffness of '{body.name}', held for its unit loads,")(forces[free])
    except NotPositiveDefiniteError as error:
        raise SingularInterfaceError(
            f"body '{body.name}': nothing holds {body.dofs.labels[free[error.row]]} while the unit loads of its "
            "geometric stiffness act; name with `held:` an interface that leaves no rigid motion, or several"
        ) from None
    return np.asarray(stiffness.forces @ u)
