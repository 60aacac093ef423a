"""Equations of one flexible body whose frame moves and turns without limit (theory section 8)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import SimulationError
from cmsreduce.model import RigidBody, Values

__all__ = ["FloatingBody", "Marker", "Stretch", "cross_columns", "euler_parameters", "refuse_massless", "turned"]

Array = NDArray[np.float64]

# Smallest eigenvalue of a mass matrix with a unit diagonal: less is round-off.
_MASSLESS = 1e-13


def cross_columns(a: Array) -> Array:
    """Matrix of a x, without the checks of `cross_matrix`: it is made some ten times in every evaluation."""
    x, y, z = a
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def turned(e: Array) -> Array:
    """Rotation matrix of Euler parameters (4,), scalar first, of any length."""
    s, x, y, z = e / np.sqrt(e @ e)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - s * z), 2 * (x * z + s * y)],
            [2 * (x * y + s * z), 1 - 2 * (x * x + z * z), 2 * (y * z - s * x)],
            [2 * (x * z - s * y), 2 * (y * z + s * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@dataclass(frozen=True, eq=False)
class Marker:
    """A point of a body: its place, and its motion by k modes, along the axes of the frame.

    Parameters
    ----------
    position : (3,) float64
        From the origin of the frame.
    translation, rotation : (3, k) float64
        Displacement and slope in each mode.
    shortening, bowing : (3, k, k) float64, optional
        Geometric stiffness per unit force and per unit moment at the point: minus the second derivatives of its
        displacement and slope.
    """

    position: Array
    translation: Array
    rotation: Array
    shortening: Array | None = None
    bowing: Array | None = None

    def on_arm(self, arm: Array) -> Marker:
        """Point at the end of a rigid arm (3,)."""
        if not arm.any():
            return self
        S = cross_columns(arm)
        shortening = self.shortening
        if self.bowing is not None:
            further = np.einsum("ij,jab->iab", S, self.bowing)
            shortening = -further if shortening is None else shortening - further
        return Marker(self.position + arm, self.translation - S @ self.rotation, self.rotation, shortening, self.bowing)


@dataclass(frozen=True, eq=False)
class Stretch:
    """Displacements of second order, q^T G q / 2, over the mass: they are what geometric stiffness does.

    Parameters
    ----------
    moment : (3, k, k) float64
        Second derivatives of int u dm.
    position : (3, 3, k, k) float64
        Second derivatives of int r_i u_j dm.
    """

    moment: Array
    position: Array

    @classmethod
    def of(cls, acceleration: Array, turning: Array, spinning: Array) -> Stretch:
        """From geometric stiffness per unit acceleration and angular acceleration (3, k, k) and per product of spin.

        Parameters
        ----------
        acceleration, turning : (3, k, k) float64
            Along x y z.
        spinning : (6, k, k) float64
            Of the products xx yy zz xy yz xz of angular velocities.

        Notes
        -----
        The load f of a unit acceleration does the work f . u, so that its stiffness is the second derivative of
        int u dm; of a unit angular acceleration, of int r x u dm. A product of angular velocities with
        W = w w^T - w.w 1 makes that of W_ij int r_j u_i dm; the three squares determine the trace.
        """
        k = acceleration.shape[1]
        trace = -0.5 * spinning[:3].sum(axis=0)
        B = np.zeros((3, 3, k, k))
        for i in range(3):
            B[i, i] = spinning[i] + trace
        for (i, j), across in zip(((0, 1), (1, 2), (0, 2)), spinning[3:], strict=True):
            # Right-handed: of axes i, j, m the moment about m is r_i u_j - r_j u_i, with the sign of the permutation.
            m, sign = 3 - i - j, 1.0 if (j - i) % 3 == 1 else -1.0
            B[i, j] = 0.5 * (across + sign * turning[m])
            B[j, i] = 0.5 * (across - sign * turning[m])
        return cls(acceleration, B)


@dataclass(frozen=True, eq=False)
class FloatingBody:
    """A body of k modes in a frame of its own, in which the modes hold no rigid motion.

    Parameters
    ----------
    name : str
        Name of the body.
    mass : float
        int dm.
    first_moment : (3,) float64
        int r dm about the origin of the frame, along its axes, as everything below.
    second_moment : (3, 3) float64
        int r r^T dm.
    phi, r_phi, phi_phi : (3, k), (3, 3, k), (3, 3, k, k) float64
        int phi dm, int r_i phi_j dm, int phi_i phi_j dm.
    M, K, D : (k, k) float64
        Modal mass, stiffness, damping.
    origin, axes : (3,), (3, 3) float64
        Frame in the basic frame of the body, axes as rows.
    markers : mapping of name to Marker
        Points by node or name.
    stretch : Stretch, optional
        Displacements of second order where the body has geometric stiffness.
    held : bool
        True if the matrices hold the body to the ground, so that its frame does not move.
    gyroscopic : (6 + k, 6 + k) float64, optional
        Gyroscopic matrix over velocity, angular velocity and modal rates. The momentum of a wheel stays along an axis
        of the body, so that it holds for any turn of the frame.
    loads : tuple of str
        Loads of the geometric stiffness that the body has, in words.
    """

    name: str
    mass: float
    first_moment: Array
    second_moment: Array
    phi: Array
    r_phi: Array
    phi_phi: Array
    M: Array
    K: Array
    D: Array
    origin: Array = field(default_factory=lambda: np.zeros(3))
    axes: Array = field(default_factory=lambda: np.eye(3))
    markers: Mapping[str, Marker] = field(default_factory=dict)
    stretch: Stretch | None = None
    held: bool = False
    gyroscopic: Array | None = None

    @classmethod
    def rigid(cls, body: RigidBody, values: Values | None = None) -> FloatingBody:
        """Body without modes; its frame is at its centre of mass, the point ``cg``, along its basic axes.

        Its wheels turn as at some values of the parameters.
        """
        none = np.zeros((3, 0))
        places = {name: face.position[0] - body.cg for name, face in body.interfaces.items()}
        markers = {name: Marker(place, none, none) for name, place in {"cg": np.zeros(3), **places}.items()}
        zero, gyroscopic = np.zeros((0, 0)), None
        momentum = body.momentum_at(values or {})
        if momentum.any():
            gyroscopic = np.zeros((6, 6))
            gyroscopic[3:, 3:] = -cross_columns(momentum)
        return cls(
            body.name,
            body.mass,
            np.zeros(3),
            0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia,
            none,
            np.zeros((3, 3, 0)),
            np.zeros((3, 3, 0, 0)),
            *(zero, zero, zero),
            origin=np.asarray(body.cg, dtype=np.float64),
            markers=markers,
            gyroscopic=gyroscopic,
        )

    @property
    def k(self) -> int:
        """Number of modes."""
        return int(self.M.shape[0])

    @cached_property
    def size(self) -> float:
        """Size of the body, in the unit of length: its radius of gyration, or a point further from its origin."""
        places = [marker.position for marker in self.markers.values()]
        gyration = np.sqrt(np.trace(self.second_moment) / self.mass)
        return float(np.linalg.norm(np.reshape(places, (-1, 3)), axis=1).max(initial=gyration))

    def deflection(self, q: Array) -> float:
        """Largest displacement of a point by the modes."""
        if not self._shapes.size:
            return 0.0
        return float(np.sqrt(((self._shapes @ q).reshape(-1, 3) ** 2).sum(axis=1).max()))

    @cached_property
    def _shapes(self) -> Array:
        return np.vstack([marker.translation for marker in self.markers.values()] or [np.zeros((0, self.k))])

    @cached_property
    def _of_modes(self) -> Array:
        """Integrals of phi_i phi_j, rows (i, j, a), to be multiplied by modal coordinates."""
        return self.phi_phi.reshape(9 * self.k, self.k)

    def wheels(self, q: Array) -> Array:
        """Momentum of the wheels along the axes of the frame (3,), to first order in their slopes."""
        if self.gyroscopic is None:
            return np.zeros(3)
        # The moment of wheels on the frame is minus the rate of their momentum h: w x h, and what slopes turn.
        W = self.gyroscopic[3:6, 3:6]
        return np.array([W[1, 2], W[2, 0], W[0, 1]]) + self.gyroscopic[3:6, 6:] @ q

    def _moments(self, q: Array) -> tuple[Array, Array, Array, Array]:
        """Int x dm and its derivatives, int x x^T dm, and int x_i dx_j/dq dm, of the deformed body."""
        moment, C = self.first_moment + self.phi @ q, self.phi
        grown, x_phi = self.r_phi @ q, self.r_phi
        pulled = (self._of_modes @ q).reshape(3, 3, self.k)
        if self.stretch is not None:
            by_moment, by_position = self.stretch.moment @ q, self.stretch.position @ q
            moment, C = moment + 0.5 * by_moment @ q, C + by_moment
            grown, x_phi = grown + 0.5 * by_position @ q, x_phi + by_position
        return moment, C, self.second_moment + grown + grown.T + pulled @ q, x_phi + pulled.swapaxes(0, 1)

    def inertia(self, q: Array, V: Array) -> tuple[Array, Array, Array]:
        """Mass matrix, forces of inertia at constant speeds, and int x dm with its derivatives.

        Parameters
        ----------
        q : (k,) float64
            Modal coordinates.
        V : (6 + k,) float64
            Velocity and angular velocity of the frame along its own axes, and modal rates.

        Returns
        -------
        M : (6 + k, 6 + k) float64
            Kinetic energy is V^T M V / 2.
        h : (6 + k,) float64
            M V' + h are the generalised forces on the body.
        moment : (3, 1 + k) float64
            int x dm, and its derivatives by the modal coordinates.

        Notes
        -----
        With the momenta p = dT/dv, L = dT/dw, the equations are p' + w x p = F, L' + w x L + v x p = N and
        d/dt dT/dq' - dT/dq = Q (Boltzmann-Hamel; Meirovitch, J. Guidance 14 (1991) 1008). The mass matrix is that of
        x = r + phi q + q^T G q / 2, linear in G, and so the geometric stiffness is in it, and energy is conserved.
        """
        v, w, rate = V[:3], V[3:6], V[6:]
        moment, C, xx, x_phi = self._moments(q)
        J = np.trace(xx) * np.eye(3) - xx
        S, W = cross_columns(moment), cross_columns(w)
        H = np.array([x_phi[1, 2] - x_phi[2, 1], x_phi[2, 0] - x_phi[0, 2], x_phi[0, 1] - x_phi[1, 0]])
        M = np.empty((6 + self.k, 6 + self.k))
        M[:3, :3], M[:3, 3:6], M[:3, 6:] = self.mass * np.eye(3), -S, C
        M[3:6, :3], M[3:6, 3:6], M[3:6, 6:] = S, J, H
        M[6:, :3], M[6:, 3:6], M[6:, 6:] = C.T, H.T, self.M
        if self.held:
            # The frame does not move. Its inertia lacks the nodes that are held, and M would be singular with it.
            M[:6, 6:] = M[6:, :6] = 0.0
            M[:6, :6] = np.diag(np.repeat([self.mass, np.trace(self.second_moment)], 3))
        flow = x_phi @ rate
        P = (self._of_modes @ rate).reshape(3, 3, self.k)
        between = np.array([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])
        moved, blown = C @ rate, W @ v
        h = np.empty(6 + self.k)
        h[:3] = self.mass * blown + W @ (W @ moment + 2 * moved)
        h[3:6] = S @ blown + W @ (J @ w) + 2 * (np.trace(flow) * w - flow.T @ w)
        outward = np.outer(w, w) - (w @ w) * np.eye(3)
        h[6:] = C.T @ blown + outward.ravel() @ x_phi.reshape(9, self.k) - 2 * w @ between
        if self.stretch is not None:
            h[:3] += (self.stretch.moment @ rate) @ rate
            B = (self.stretch.position @ rate) @ rate
            h[3:6] += [B[1, 2] - B[2, 1], B[2, 0] - B[0, 2], B[0, 1] - B[1, 0]]
        return M, h, np.column_stack([moment, C])


def refuse_massless(body: FloatingBody) -> None:
    """Refuse a body that can move without kinetic energy.

    Raises
    ------
    SimulationError
        With the likely cause.
    """
    M = body.inertia(np.zeros(body.k), np.zeros(6 + body.k))[0]
    scale = np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
    if la.eigvalsh(M / scale / scale[:, None], subset_by_index=[0, 0])[0] < _MASSLESS:
        raise SimulationError(
            f"body '{body.name}' can move without kinetic energy: it is a point or a line without inertia about "
            "itself, or its modes hold a rigid motion; give it the inertia of its thickness, or take these modes out"
        )


def euler_parameters(R: Array) -> Array:
    """Euler parameters (4,), scalar first, of a rotation matrix."""
    # Scipy's order has the scalar last.
    from scipy.spatial.transform import Rotation

    x, y, z, s = Rotation.from_matrix(R).as_quat()
    return np.array([s, x, y, z])
