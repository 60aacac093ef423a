"""Inertia forces of a body whose frame accelerates, turns faster, or spins (theory section 8).

Geometric stiffness of a body of bars under unit loads: the stress of each, by statics, and what it adds to K.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError, SceneError, SingularInterfaceError
from cmsreduce.linalg.blocks import congruence
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.mechanics.bars import BarStiffness
from cmsreduce.mechanics.modal_integrals import MassBlocks, nodal_motion
from cmsreduce.model import (
    INERTIA_LOADS,
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


BARS = "bars of the deck"
"""What a computed matrix comes from."""


def bars_stiffness(
    body: FEModel,
    bars: Bars,
    loads: Sequence[UnitLoad] = INERTIA_LOADS,
    *,
    held: NDArray[np.int64],
    origin: Array | None = None,
    holding: str = "",
    hidden: Recovery | None = None,
) -> GeometricStiffness:
    """Geometric stiffness of a body of bars and beams for each of some unit loads.

    Parameters
    ----------
    body : FEModel
        n dofs; whatever it is of besides bars adds no geometric stiffness.
    bars : Bars
        Its bars, in its units.
    loads : sequence of UnitLoad
        Loads; those at a point name a node.
    held : (h,) int64
        Rows at rest while the loads act, as by the frame that the body moves with; none for a body that is held.
    origin : (3,) float64, optional
        Point the frame turns about, in basic; its origin if absent.
    holding : str
        What holds those rows, in words.
    hidden : Recovery, optional
        Motion of dofs of the bars that have no row, of the rows.

    Raises
    ------
    SingularInterfaceError
        If the body can still move without strain when these rows are held.

    Notes
    -----
    Under a load p f the stress, and with it the stiffness that it adds, is p times that under f: u = K^-1 f with the
    rows held, the force along each bar from u, and the geometric stiffness of the bar under it. Forces that balance
    leave no reaction, and their stress does not depend on where the body is held, if it is held just so far that it
    cannot move as one piece.
    """
    about = np.zeros(3) if origin is None else np.asarray(origin, dtype=np.float64)
    stiffness = BarStiffness(body, bars, hidden)
    tension = _tensions(body, stiffness, unit_forces(body, loads, about), held)
    matrices = tuple(stiffness.stiffness(column) for column in tension.T)
    return GeometricStiffness(tuple(loads), matrices, (BARS,) * len(matrices), about, holding)


def modal_stiffening(stiffening: GeometricStiffness, Phi: Array) -> ModalStiffening:
    """Geometric stiffness of a body in its modes Phi (n, m): Phi^T K_l Phi of each unit load l."""
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
