"""Motions of flexible bodies in a moving frame, integrated by scipy from the matrices of the finite elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import solve_ivp

from cmsreduce.model import ModalComponent, cross_matrix, rigid_body_shapes

__all__ = ["HingedPair", "PlaneBeam", "tumbling_tip"]

# Of the integrator, relative and absolute: four orders under what is asserted of either motion.
_RTOL, _ATOL = 1e-10, 1e-12


@dataclass(frozen=True)
class PlaneBeam:
    """A beam along x that bends in its plane and turns about z at its root.

    Parameters
    ----------
    inertia : float
        About the root.
    length : float
        From the root to the tip.
    lam, h, tip : (k,) float64
        Squared frequencies of the clamped beam, int x phi dm, and motion of the tip across the beam.
    """

    inertia: float
    length: float
    lam: np.ndarray
    h: np.ndarray
    tip: np.ndarray

    @classmethod
    def of(cls, K: np.ndarray, M: np.ndarray, x: np.ndarray, count: int) -> PlaneBeam:
        """From matrices over y and rz of nodes at x, the root first, and a number of modes."""
        lam, phi = la.eigh(K[2:, 2:], M[2:, 2:], subset_by_index=[0, count - 1])
        turn = np.column_stack([x, np.ones_like(x)]).ravel()
        return cls(float(turn @ M @ turn), x[-1], lam, phi.T @ (M @ turn)[2:], phi[-2])

    def spun_up(self, torque: Callable[[float], float], times: np.ndarray) -> np.ndarray:
        """Position of the tip in the plane (times, 2), and its deflection last (times, 3).

        (J + q.q) a + h.q'' + 2 w q.q' = T, q'' + h a + (lam - w^2) q = 0: shapes that move across the beam alone feel
        no centrifugal force but that of their own deflection.
        """
        k = self.lam.size

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            q, w, v = y[1 : 1 + k], y[1 + k], y[2 + k :]
            free = (w**2 - self.lam) * q
            a = (torque(t) - 2 * w * (q @ v) - self.h @ free) / (self.inertia + q @ q - self.h @ self.h)
            return np.r_[w, v, a, free - self.h * a]

        start = np.zeros(2 * k + 2)
        found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=_RTOL, atol=_ATOL).y
        theta, across = found[0], self.tip @ found[1 : 1 + k]
        c, s = np.cos(theta), np.sin(theta)
        return np.column_stack([self.length * c - across * s, self.length * s + across * c, across])


def tumbling_tip(
    M: sp.csc_array,
    xyz: np.ndarray,
    Phi: np.ndarray,
    omega: np.ndarray,
    node: int,
    spin: np.ndarray,
    force: np.ndarray,
    times: np.ndarray,
) -> np.ndarray:
    """Position of a node (times, 3), pulled by a constant force, of a free body that starts turning undeformed.

    D'Alembert's principle over all nodes: with B = [1, -r x, Phi] what (v', w', q'') do to them along the frame's axes,
    and c the accelerations that are left, w x (w x r) + 2 w x u', it is B^T (M (B a + c) - f) + (0, 0, omega^2 q) = 0.
    The mass matrix ``M`` (3n, 3n) must be the same in every direction. No integral over shapes is formed.
    """
    k, n = omega.size, len(xyz)
    shapes = Phi.reshape(n, 3, k)
    MB_fixed = M @ Phi

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        e, v, w, q, dq = y[3:7], y[7:10], y[10:13], y[13 : 13 + k], y[13 + k :]
        r, du = xyz + shapes @ q, shapes @ dq
        B = np.hstack([np.tile(np.eye(3), (n, 1)), -cross_matrix(r).reshape(3 * n, 3), Phi])
        left = np.cross(w, np.cross(w, r)) + 2 * np.cross(w, du)
        MB = np.hstack([M @ B[:, :6], MB_fixed])
        A = rotation(e)
        pull = B[3 * node : 3 * node + 3].T @ (A.T @ force)
        a = np.linalg.solve(B.T @ MB, pull - MB.T @ left.ravel() - np.r_[np.zeros(6), omega**2 * q])
        de = 0.5 * np.r_[-e[1:] @ w, e[0] * w + np.cross(e[1:], w)]
        return np.r_[v, de, A @ a[:3], a[3:6], dq, a[6:]]

    start = np.r_[np.zeros(3), 1.0, np.zeros(3), np.zeros(3), spin, np.zeros(2 * k)]
    found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=_RTOL, atol=_ATOL).y.T
    return np.array([y[:3] + rotation(y[3:7]) @ (xyz[node] + shapes[node] @ y[13 : 13 + k]) for y in found])


def rotation(e: np.ndarray) -> np.ndarray:
    """Rotation matrix of Euler parameters, scalar first."""
    e = e / np.linalg.norm(e)
    S = cross_matrix(e[1:])
    return np.eye(3) + 2 * e[0] * S + 2 * S @ S


@dataclass(frozen=True)
class _Nodes:
    """A flexible body in a frame at a clamped point: velocities of all dofs are (R v_w + C(q) w + Phi q').

    Parameters
    ----------
    M : (n, n) float64
        Mass matrix of the finite elements, or of amplitudes of all motions below.
    rigid : (n, 6) float64
        Rigid motions about the clamped point.
    Phi : (n, k) float64
        Shapes that do not move this point.
    swing : (n, 3, k) float64
        Motion of the dofs for a unit rotation of the frame about x, y, z, per unit of each shape.
    stiffness, damping : (k, k) float64
        Modal.
    """

    M: np.ndarray
    rigid: np.ndarray
    Phi: np.ndarray
    swing: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    @classmethod
    def of(cls, component: ModalComponent, interface: str) -> _Nodes:
        """Elastic modes of a free body, less the rigid motion of one node in each."""
        body = component.body
        rows, rigid = (
            body.interface_rows(interface),
            rigid_body_shapes(body.dofs, body.nodes, body.interfaces[interface].position[0]),
        )
        elastic = slice(component.rigid_count, None)
        Phi = component.Phi[:, elastic]
        Phi = Phi - rigid @ np.linalg.solve(rigid[rows], Phi[rows])
        at, component_of = body.nodes.index(body.dofs.node), body.dofs.component
        moved = np.zeros((len(body.nodes.id), 3, Phi.shape[1]))
        for row in np.flatnonzero(component_of <= 3):
            moved[at[row]] += np.outer(body.nodes.frame[at[row], component_of[row] - 1], Phi[row])
        swing = np.zeros((body.n, 3, Phi.shape[1]))
        for row in np.flatnonzero(component_of <= 3):
            axis = body.nodes.frame[at[row], component_of[row] - 1]
            # e . (w x u) = w . (u x e)
            swing[row] = np.cross(moved[at[row]], axis[:, None], axis=0)
        # The dofs move in these ways only: their amplitudes are fewer.
        k, omega = Phi.shape[1], component.omega[elastic]
        ways = np.hstack([rigid, Phi, swing.reshape(body.n, 3 * k)])
        one = np.eye(ways.shape[1])
        M, swung = ways.T @ (body.M @ ways), one[:, 6 + k :].reshape(-1, 3, k)
        damping = np.diag(2 * component.zeta[elastic] * omega)
        return cls(M, one[:, :6], one[:, 6 : 6 + k], swung, np.diag(omega**2), damping)

    def inertia_force(self, s: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix over (v, w, q') along the frame's axes, and the forces that hold without acceleration.

        Boltzmann and Hamel: with p = dT/ds, (p_v' + w x p_v, p_w' + w x p_w + v x p_v, p_q' - dT/dq).
        """
        v, w, rate = s[:3], s[3:6], s[6:]
        B = np.hstack([self.rigid, self.Phi])
        B[:, 3:6] += self.swing @ q
        MB = self.M @ B
        momentum = MB @ s
        turned = self.swing @ rate
        force = MB.T @ (turned @ w)
        force[3:6] += turned.T @ momentum
        p = B.T @ momentum
        force[:3] += np.cross(w, p[:3])
        force[3:6] += np.cross(w, p[3:6]) + np.cross(v, p[:3])
        force[6:] += self.stiffness @ q + self.damping @ rate - np.einsum("n,nak,a->k", momentum, self.swing, w)
        return B.T @ MB, force


class HingedPair:
    """Two flexible bodies that float and turn against each other about z of the point to which both are clamped.

    Lagrange's equations over all nodes, by the mass matrices of the finite elements; no integral over shapes is formed.

    Parameters
    ----------
    first, second : ModalComponent
        Elastic modes of the free bodies.
    interface : str
        The same on both.
    """

    def __init__(self, first: ModalComponent, second: ModalComponent, interface: str) -> None:
        self.bodies = _Nodes.of(first, interface), _Nodes.of(second, interface)

    def turned_by(self, torque: Callable[[float], float], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle of the hinge (times,), and modal coordinates of both bodies (times, k), from rest."""
        a, b = self.bodies
        ka, kb = a.Phi.shape[1], b.Phi.shape[1]
        n, z = 7 + ka + kb, np.array([0.0, 0.0, 1.0])
        own = np.zeros((6 + ka, n))
        own[:6, :6], own[6:, 7 : 7 + ka] = np.eye(6), np.eye(ka)

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            angle, q, s = y[0], y[1 : 1 + ka + kb], y[1 + ka + kb :]
            c, d = np.cos(angle), np.sin(angle)
            A = np.array([[c, d, 0.0], [-d, c, 0.0], [0.0, 0.0, 1.0]])
            other = np.zeros((6 + kb, n))
            other[:3, :3], other[3:6, 3:6], other[3:6, 6], other[6:, 7 + ka :] = A, A, z, np.eye(kb)
            left = np.zeros(6 + kb)
            left[:3], left[3:6] = -s[6] * np.cross(z, A @ s[:3]), -s[6] * np.cross(z, A @ s[3:6])
            Ma, fa = a.inertia_force(own @ s, q[:ka])
            Mb, fb = b.inertia_force(other @ s, q[ka:])
            load = -own.T @ fa - other.T @ (fb + Mb @ left)
            load[6] += torque(t)
            return np.r_[s[6], s[7:], la.solve(own.T @ Ma @ own + other.T @ Mb @ other, load, assume_a="pos")]

        start = np.zeros(1 + ka + kb + n)
        found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-8, atol=1e-11).y
        return found[0], found[1 : 1 + ka + kb].T
