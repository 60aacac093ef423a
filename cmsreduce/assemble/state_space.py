"""State space of an assembled system: in modal states, its elastic part alone, and a model of the control package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.modes import undetermined
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import UndeterminedError, elastic_and_massless, split_massless
from cmsreduce.model import System

__all__ = ["ElasticStates", "ModalStates", "elastic_states", "modal_states", "state_space"]

Array = NDArray[np.float64]

# Damping couples rigid motions to elastic ones when it resists them by more than this share of its largest entry.
_DAMPED = 1e-9
# A has (2 N)^2 entries: 128 MiB at this size.
_LARGEST = 2000
# Damping of a massless shape is zero if its force is below this share of the spring's at the highest frequency.
_NO_DAMPING = 1e-6
# A product below this share of the size of its factors, or of the absolute parts of its sum, is round-off.
_ROUND_OFF = 1e-12


@dataclass(frozen=True, eq=False)
class ElasticStates:
    """z' = A z + B u, y = C z + D u with z = [w q; q'] of the e elastic modes.

    Parameters
    ----------
    A, B, C : (2e, 2e), (2e, inputs), (outputs, 2e) float64
        The elastic part.
    D : (outputs, inputs) float64
        Flexibility of shapes without mass.
    rigid_B : (R, inputs) float64
        Rigid motions a'' = rigid_B u, in parallel with the elastic part.
    rigid_C1, rigid_C2 : (outputs, R) float64
        Their part in the outputs, C1 a + C2 a'.
    omega : (e,) float64
        Undamped frequencies in rad/s.
    Phi : (N, e) float64
        Modes in the system's coordinates, orthonormal in M.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    rigid_B: Array
    rigid_C1: Array
    rigid_C2: Array
    omega: Array
    Phi: Array

    def states_of(self, rows: Array) -> tuple[Array, Array]:
        """Matrices (p, 2e) from z to the elastic displacements and rates of motions over the coordinates (p, N)."""
        shapes = rows @ self.Phi
        none = np.zeros_like(shapes)
        return np.hstack([shapes / self.omega, none]), np.hstack([none, shapes])


def elastic_states(system: System) -> ElasticStates:
    """Split a reduced system into its elastic modes and its rigid motions.

    Parameters
    ----------
    system : System
        Reduced.

    Raises
    ------
    MatrixError
        If damping is a complex stiffness, or acts on the rigid motions, so that the two parts are not in parallel, or a
        shape without mass is damped or moves a rate output.
    """
    _refuse_size_and_loss(system)
    K, M = dense(system.K), dense(system.M)
    D = np.zeros_like(K) if system.D is None else dense(system.D)
    lam, Phi, N = elastic_and_massless(K, M, system.rigid, system.rounding)
    w = np.sqrt(lam)
    modal = Phi.T @ D @ Phi
    if system.rigid.shape[1] and abs(D @ system.rigid).max(initial=0.0) > _DAMPED * abs(D).max(initial=0.0):
        raise MatrixError(
            "the damping acts on the system's rigid motions, so that its elastic part cannot be balanced alone"
        )
    if N.shape[1]:
        _refuse_rates(system, N, float(w.max(initial=0.0)))
    A = np.block([[np.zeros((w.size, w.size)), np.diag(w)], [-np.diag(w), -modal]])
    force = Phi.T @ system.B
    return ElasticStates(
        A,
        np.vstack([np.zeros_like(force), force]),
        np.hstack([system.C1 @ Phi / w, system.C2 @ Phi]),
        (system.C1 @ N) @ (N.T @ system.B),
        system.rigid.T @ system.B,
        system.C1 @ system.rigid,
        system.C2 @ system.rigid,
        w,
        Phi,
    )


@dataclass(frozen=True, eq=False)
class ModalStates:
    """x' = A x + B u, y = C x + D u with x = [q; q'], amplitudes of the m undamped modes, rigid motions first.

    Parameters
    ----------
    A, B, C, D : (2m, 2m), (2m, inputs), (outputs, 2m), (outputs, inputs) float64
        The model; D is the flexibility of shapes without mass.
    omega : (m,) float64
        Undamped frequencies, zeros first.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    omega: Array


def modal_states(system: System) -> ModalStates:
    """State space of a reduced system in its undamped modes, of unit modal mass.

    Rigid motions have no stiffness at all here, so that a free system drifts without the error of round-off in K.

    Raises
    ------
    MatrixError
        As `state_space` does.
    """
    _refuse_size_and_loss(system)
    K, M = dense(system.K), dense(system.M)
    try:
        lam, X, N = elastic_and_massless(K, M, system.rigid, system.rounding)
    except UndeterminedError as error:
        raise undetermined(system, error) from None
    omega = np.concatenate([np.zeros(system.rigid.shape[1]), np.sqrt(lam)])
    if N.shape[1]:
        _refuse_rates(system, N, omega.max(initial=0.0))
    Phi, m = np.hstack([system.rigid, X]), omega.size
    damping = np.zeros((m, m)) if system.D is None else _product(Phi.T, dense(system.D) @ Phi)
    if not system.gyroscopic:
        damping = 0.5 * (damping + damping.T)
    force, zero = Phi.T @ system.B, np.zeros((m, m))
    return ModalStates(
        np.block([[zero, np.eye(m)], [-np.diag(omega**2), -damping]]),
        np.vstack([np.zeros_like(force), force]),
        np.hstack([system.C1 @ Phi, system.C2 @ Phi]),
        (system.C1 @ N) @ (N.T @ system.B),
        omega,
    )


def state_space(system: System) -> Any:
    """Make a ``control.StateSpace`` of a reduced system.

    Parameters
    ----------
    system : System
        Reduced; states are its N coordinates, then their rates. Where the system has s shapes without mass, states are
        amplitudes of the N - s other shapes, then their rates, and the flexibility of the massless ones,
        C1 N (N^T K N)^-1 N^T B, is the feedthrough.

    Returns
    -------
    control.StateSpace
        With input and output names, in which an underscore replaces the point, because the package reserves it.

    Raises
    ------
    MatrixError
        If the system is too large for a dense matrix, or its damping is a complex stiffness, which has no real state
        space, or a shape without mass is damped, moves a rate output, or has no stiffness either.
    """
    # Imported here because it loads matplotlib.
    import control

    _refuse_size_and_loss(system)
    M, K = dense(system.M), dense(system.K)
    D = np.zeros_like(M) if system.D is None else dense(system.D)
    try:
        T, weight, N = split_massless(K, M, system.rounding)
    except UndeterminedError as error:
        raise undetermined(system, error) from None
    if N.shape[1]:
        highest = float((np.einsum("ij,ij->j", T, K @ T) / weight).max(initial=0.0))
        _refuse_rates(system, N, np.sqrt(highest))
    else:
        T = np.eye(system.N)
    M, K, D = (T.T @ A @ T for A in (M, K, D))
    factor, zero = la.cho_factor(M), np.zeros_like(M)
    A = np.block([[zero, np.eye(M.shape[0])], [-la.cho_solve(factor, K), -la.cho_solve(factor, D)]])
    B = np.vstack([np.zeros((M.shape[0], system.B.shape[1])), la.cho_solve(factor, T.T @ system.B)])
    C = np.hstack([system.C1 @ T, system.C2 @ T])
    feedthrough = (system.C1 @ N) @ (N.T @ system.B)
    inputs, outputs = ([name.replace(".", "_") for name in names] for names in (system.inputs, system.outputs))
    return control.ss(A, B, C, feedthrough, inputs=inputs, outputs=outputs)


def _refuse_size_and_loss(system: System) -> None:
    if system.N > _LARGEST:
        raise MatrixError(
            f"a state space needs a reduced system; this one has {system.N} coordinates, more than {_LARGEST}: "
            "reduce its bodies first"
        )
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no real state space; use modal damping")


def _refuse_rates(system: System, N: Array, top: float) -> None:
    """Refuse damping and outputs that need the rate of a massless shape: the derivative of a load is no state."""
    if system.D is not None and (np.einsum("ij,ij->j", N, system.D @ N) * top > _NO_DAMPING).any():
        raise MatrixError(
            "a shape without mass is damped, so that it lags behind its load as no pair of states does; give "
            "its body a modal damping ratio, which does not act on such shapes"
        )
    D = None if system.D is None else dense(system.D)
    if D is not None and system.gyroscopic and abs(D @ N).max() > _ROUND_OFF * abs(D).max() * abs(N).max():
        raise MatrixError(
            "gyroscopic forces act on a shape without mass, which adds mass to the others as no state space of them "
            "has it; give the node of the wheel its inertia"
        )
    rates, loads = _product(system.C2, N), _product(N.T, system.B)
    derived = abs(rates @ loads) > _ROUND_OFF * (abs(rates) @ abs(loads))
    if derived.any():
        output, into = np.argwhere(derived)[0]
        raise MatrixError(
            f"the rate output '{system.outputs[output]}' moves with a shape without mass on which "
            f"'{system.inputs[into]}' acts, so that it contains the derivative of that input, which is not possible in "
            "a state space; measure the displacement"
        )


def _product(A: Array, B: Array) -> Array:
    """A B without its round-off."""
    AB = A @ B
    size = np.outer(np.linalg.norm(A, axis=1), np.linalg.norm(B, axis=0))
    return np.where(abs(AB) > _ROUND_OFF * size, AB, 0.0)
