"""Motions of flexible bodies in a moving frame, integrated by scipy from the matrices of the finite elements."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import solve_ivp

from cmsreduce.model import cross_matrix

__all__ = ["PlaneBeam", "tumbling_tip"]

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
