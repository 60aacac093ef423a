"""State space of a reduced system in its modes, with the loop of a controller closed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, Controller
from cmsreduce.pipeline.system.assembled import AssembledModel

__all__ = ["ClosedLoop", "closed_loop"]

Array = NDArray[np.float64]

# All roots of a system of this many coordinates take half a minute.
_LARGEST = 1000
# Damping of a massless shape is none if its force is below this share of the spring's at the highest frequency.
_NO_DAMPING = 1e-6
# A product below this share of the size of its factors is rounding.
_ROUND_OFF = 1e-12


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """z' = A z + B n, y = C z + E n, with a noise n added to what the controller measures.

    The states are the amplitudes of the motions, their rates, the amplitudes of damped massless shapes, and the states
    of the controller.

    Parameters
    ----------
    A : (N, N) float64
        Open loop without a controller.
    B : (N, outputs) float64
        Zero without a controller.
    C : (outputs, N) float64
        Signals of the sensors without their noise.
    motions : (coordinates, k) float64
        Rigid motions and elastic modes of the system, orthonormal in its mass.
    plant : int
        Number of states that are not the controller's.
    """

    A: Array
    B: Array
    C: Array
    motions: Array
    plant: int


def closed_loop(
    model: AssembledModel, configuration: Configuration, controller: Controller | None = None
) -> ClosedLoop | None:
    """State space of a reduced system, with a controller or alone.

    Parameters
    ----------
    model : AssembledModel
        The reduced system.
    configuration : Configuration
        Positions of the joints.
    controller : Controller, optional
        u = -v for its efforts v.

    Returns
    -------
    ClosedLoop or None
        None if the system is large or has no real state space: a complex stiffness, a rate that is measured where an
        actuator moves a shape without mass, gyroscopic forces on such a shape, or an algebraic loop that is singular.

    Notes
    -----
    With x the amplitudes of rigid motions and modes and n those of damped massless shapes, whose D is diag(d):

        x'' + D_xx x' + W^2 x + D_xn n' = B_x u,        d n' + D_nx x' + n = B_n u,
        y = C_x x + R_x x' + C_n n + R_n n' + F u
    """
    system = model.system(configuration)
    if system.loss is not None or system.N > _LARGEST:
        return None
    w, Phi, static = model.every_mode(configuration)
    X, D = np.hstack([system.rigid, Phi]), np.zeros((system.N, system.N)) if system.D is None else dense(system.D)
    if system.gyroscopic and (abs(D @ static) > _ROUND_OFF * abs(D).max() * abs(static).max(axis=0)).any():
        return None
    drag, Y = la.eigh(static.T @ D @ static) if static.shape[1] else (np.empty(0), np.empty((0, 0)))
    lags = drag * w.max(initial=1.0) > _NO_DAMPING
    slow, quick, d = static @ Y[:, lags], static @ Y[:, ~lags], drag[lags]
    rates, loads = system.C2 @ quick, quick.T @ system.B
    size = np.linalg.norm(system.C2, axis=1)[:, None] * np.sum(quick**2) * np.linalg.norm(system.B, axis=0)
    if controller is not None and (abs(rates @ loads) > _ROUND_OFF * size).any():
        return None
    if controller is None:
        p, q = len(system.inputs), len(system.outputs)
        controller = Controller(np.empty((0, 0)), np.empty((0, q)), np.empty((p, 0)), np.zeros((p, q)))
    k, m, c = X.shape[1], slow.shape[1], controller.states
    push, still, moving = (_without_rounding(A, X) for A in (system.B.T, system.C1, system.C2))
    stiffness = np.concatenate([np.zeros(system.rigid.shape[1]), w**2])
    D_xx, D_xn = X.T @ D @ X, X.T @ D @ slow
    # n' over (x, x', n, controller) and over u.
    n_z = np.hstack([np.zeros((m, k)), -D_xn.T, -np.eye(m), np.zeros((m, c))]) / d[:, None]
    n_u = (slow.T @ system.B) / d[:, None]
    v_z = np.hstack([-np.diag(stiffness), -D_xx, np.zeros((k, m + c))]) - D_xn @ n_z
    v_u = push.T - D_xn @ n_u
    y_z = np.hstack([still, moving, system.C1 @ slow, np.zeros((system.C1.shape[0], c))])
    y_z, y_u = y_z + system.C2 @ slow @ n_z, (system.C1 @ quick) @ loads + system.C2 @ slow @ n_u
    states = np.hstack([np.zeros((controller.C.shape[0], 2 * k + m)), controller.C])
    loop = np.eye(states.shape[0]) + controller.D @ y_u
    if loop.size and np.linalg.cond(loop) > 1 / _ROUND_OFF:
        return None
    u_z, u_n = (-np.linalg.solve(loop, part) for part in (states + controller.D @ y_z, controller.D))
    own = np.hstack([np.zeros((c, 2 * k + m)), controller.A])
    A = np.vstack(
        [
            np.hstack([np.zeros((k, k)), np.eye(k), np.zeros((k, m + c))]),
            v_z + v_u @ u_z,
            n_z + n_u @ u_z,
            own + controller.B @ (y_z + y_u @ u_z),
        ]
    )
    B = np.vstack([np.zeros((k, u_n.shape[1])), v_u @ u_n, n_u @ u_n, controller.B + controller.B @ y_u @ u_n])
    return ClosedLoop(A, B, y_z + y_u @ u_z, X, 2 * k + m)


def _without_rounding(rows: Array, X: Array) -> Array:
    """Products of rows and motions, zero where they are rounding.

    A force between two bodies does not act on a rigid motion, nor does a sensor between them see it. A controller turns
    the rounding e of either into a spring, and with it a double root at zero into a growing one, +- sqrt(e).
    """
    product, size = rows @ X, np.linalg.norm(rows, axis=1)[:, None] * np.linalg.norm(X, axis=0)
    return np.asarray(np.where(abs(product) > _ROUND_OFF * size, product, 0.0))
