"""Vibration of a body in a frame that spins at a steady rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

__all__ = ["SpinningModes", "spinning_modes"]

Array = NDArray[np.float64]

# Of the highest frequency: a root that is damped or grows by less does so by round-off of the eigenvalues.
_NEUTRAL = 1e-7


@dataclass(frozen=True, eq=False)
class SpinningModes:
    """Small vibrations about the spinning, unstretched body.

    Parameters
    ----------
    omega : (f,) float64
        Frequencies in rad per unit of time as seen in the spinning frame, ascending.
    growth : float
        Fastest growth in 1 per unit of time; 0 if none grows.
    """

    omega: Array
    growth: float


def spinning_modes(K: Array, phi_phi: Array, velocity: Array, stress: Array | None = None) -> SpinningModes:
    """Vibrations in a spinning frame: M q'' + 2 G q' + (K + K_g + C) q = 0.

    Parameters
    ----------
    K : (k, k) float64
        Stiffness of modes that leave the frame at rest.
    phi_phi : (3, 3, k, k) float64
        int phi_i phi_j dm of them; its trace is their mass M, positive definite.
    velocity : (3,) float64
        Angular velocity w in rad per unit of time.
    stress : (k, k) float64, optional
        Geometric stiffness K_g at that velocity; none if absent.

    Notes
    -----
    G_ab = int phi_a . (w x phi_b) dm is the Coriolis term, and C_ab = int phi_a . (w w^T - w.w 1) phi_b dm the
    softening by the centrifugal force that grows with the deflection.
    """
    w = np.asarray(velocity, dtype=np.float64)
    M = np.einsum("iiab->ab", phi_phi)
    outward = np.outer(w, w) - w @ w * np.eye(3)
    C = np.einsum("ij,ijab->ab", outward, phi_phi)
    turn = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    G = np.einsum("ij,ijab->ab", turn, phi_phi)
    k = M.shape[0]
    total = K + C + (0.0 if stress is None else stress)
    L = la.cholesky(M, lower=True)

    def unit_mass(A: Array) -> Array:
        return np.asarray(la.solve_triangular(L, la.solve_triangular(L, A, lower=True).T, lower=True).T)

    A = np.block([[np.zeros((k, k)), np.eye(k)], [-unit_mass(total), -2 * unit_mass(G)]])
    roots = la.eigvals(A)
    top = abs(roots).max(initial=0.0)
    omega = np.sort(roots.imag[roots.imag > _NEUTRAL * top])
    growth = float(roots.real.max(initial=0.0))
    return SpinningModes(omega, growth if growth > _NEUTRAL * top else 0.0)
