"""Roots of s^2 M + s D + K + i loss over a basis in which stiffness is one and mass is diagonal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.model import Matrix

__all__ = ["Basis", "DampedPencil", "Roots", "energy"]

# The quotient of its own shape sharpens a root, unless the shape is nearly orthogonal to itself, as a mixture of a
# repeated mode's shapes may be: below this share of what it would be without cancellation.
_CANCELS = 0.01

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class Basis:
    """What a damped system is projected on: elastic shapes, and rigid motions that damping brakes.

    Parameters
    ----------
    V : (N, m) float64
        Elastic shapes with V^T K V = 1 and V^T M V = diag(root_mass^2).
    root_mass : (m,) float64
        1/w for an undamped mode; 0 for a shape without mass.
    braked : (N, b) float64
        Rigid motions, orthonormal in M and M-orthogonal to V; D is diagonal and positive on them.
    """

    V: Real
    root_mass: Real
    braked: Real


@dataclass(frozen=True, eq=False)
class Roots:
    """Some roots, by ascending magnitude, none with Im s < 0.

    Parameters
    ----------
    s : (k,) complex128
        Roots in rad/s.
    X : (N, k) complex128
        Their shapes.
    x : (m, k) complex128
        What the shapes are made of: amplitudes of the elastic shapes of the basis.
    """

    s: Complex
    X: Complex
    x: Complex


@dataclass(frozen=True, eq=False)
class DampedPencil:
    """A damped system: s^2 M x + s D x + (K + i loss) x = 0.

    Parameters
    ----------
    K, M : (N, N) Matrix
        Stiffness and mass, symmetric, positive semidefinite.
    D, loss : (N, N) Matrix, optional
        Viscous damping and the imaginary part of the stiffness, of the same kind.
    """

    K: Matrix
    M: Matrix
    D: Matrix | None
    loss: Matrix | None

    @property
    def N(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def residual(self, found: Roots, KV: Real) -> Complex:
        """What each root and its shape leave of the equation (N, k).

        ``KV`` is K times the elastic shapes of the basis; as w^2 M V for modes it has none of the rounding that the
        product with a stiff K has.
        """
        r = (self.M @ found.X) * found.s**2 + KV @ found.x
        if self.D is not None:
            r = r + (self.D @ found.X) * found.s
        if self.loss is not None:
            r = r + 1j * (self.loss @ found.X)
        return np.asarray(r)

    def slope(self, found: Roots) -> Real:
        """How steeply the equation changes with s over each shape, x^H (2 |s| M + D) x (k,)."""
        slope = 2 * abs(found.s) * energy(found.X, self.M)
        return slope if self.D is None else slope + energy(found.X, self.D)

    def roots(self, basis: Basis, omega: float) -> Roots:
        """Roots with |s| up to ``omega`` rad/s in the span of a basis, one of each conjugate pair.

        Notes
        -----
        Turned over, mu = 1/s, so that soft modes keep their digits and shapes without mass, mu = 0, drop out. With
        S = diag(root_mass), y = s S x, C = (1 + i loss)^-1 and v the velocities of braked rigid motions, whose
        positions have the root s = 0 that is left out:

            mu v = -D_rr^-1 (v + D_re x)
            mu x = C (D_er D_rr^-1 (v + D_re x) - D_ee x - S y)
            mu y = S x
        """
        S, b, m = basis.root_mass, basis.braked.shape[1], basis.root_mass.size
        L = None if self.loss is None else np.asarray(basis.V.T @ (self.loss @ basis.V))
        C = None if L is None else np.asarray(la.inv(np.eye(m) + 1j * L), dtype=np.complex128)
        if self.D is None:
            D = np.zeros((m, m))
            mu, x = _conservative(S, C)
            v = np.empty((0, mu.size), dtype=np.complex128)
        else:
            both = np.hstack([basis.braked, basis.V])
            D = np.asarray(both.T @ (self.D @ both))
            mu, states = la.eig(_turned_over(S, C, D, b))
            v, x = (np.asarray(part, dtype=np.complex128) for part in (states[:b], states[b : b + m]))
        keep = (abs(mu) * omega >= 1) & (mu.imag <= 0)
        s, v, x = 1 / mu[keep], v[:, keep], x[:, keep]
        s = _sharpened(s, v, x, S, D, L)
        order = np.argsort(abs(s), kind="stable")
        X = basis.V @ x + basis.braked @ (v / s)
        return Roots(s[order], X[:, order], x[:, order])


def _conservative(S: Real, C: Complex | None) -> tuple[Complex, Complex]:
    """Without viscous damping the roots come from s^2 alone, of half the size."""
    if C is None:
        return -1j * S.astype(np.complex128), np.eye(S.size, dtype=np.complex128)
    nu, y = la.eig(S[:, None] * C * S)
    return -1j * np.sqrt(nu), C @ (S[:, None] * y)


def _turned_over(S: Real, C: Complex | None, D: Real, b: int) -> Real | Complex:
    m = S.size
    brake = D[:b, b:] / D[:b, :b].diagonal()[:, None]
    x_from = np.hstack([brake.T, brake.T @ D[:b, b:] - D[b:, b:], -np.diag(S)])
    rows = [
        np.hstack([-np.diag(1 / D[:b, :b].diagonal()), -brake, np.zeros((b, m))]),
        x_from if C is None else C @ x_from,
        np.hstack([np.zeros((m, b)), np.diag(S), np.zeros((m, m))]),
    ]
    return np.vstack(rows)


def _sharpened(s: Complex, v: Complex, x: Complex, S: Real, D: Real, L: Real | None) -> Complex:
    """One Newton step on q^T Z(s) q = 0, which squares the error that a shape q leaves in its root."""
    q = np.vstack([v / s, x])
    mass = np.sum((v / s) ** 2, axis=0) + np.sum((S[:, None] * x) ** 2, axis=0)
    damping = np.einsum("ij,ij->j", q, D @ q)
    stiffness = np.sum(x**2, axis=0) + (0 if L is None else 1j * np.einsum("ij,ij->j", x, L @ x))
    slope = 2 * s * mass + damping
    length = np.sum(abs(v / s) ** 2, axis=0) + np.sum(abs(S[:, None] * x) ** 2, axis=0)
    sound = abs(slope) > _CANCELS * (2 * abs(s) * length + np.einsum("ij,ij->j", q.conj(), D @ q).real)
    step = (s**2 * mass + s * damping + stiffness) / np.where(sound, slope, 1.0)
    return np.asarray(np.where(sound, s - step, s))


def energy(X: Complex, A: Matrix) -> Real:
    """x^H A x of each column (k,)."""
    return np.asarray(np.einsum("ij,ij->j", X.conj(), np.asarray(A @ X)).real)
