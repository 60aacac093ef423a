"""A damped system s^2 M + s D + K + i loss, and its roots in the span of a basis by dense algebra."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Matrix, is_gyroscopic

__all__ = ["DampedPencil", "PencilBasis", "PencilRoots", "hermitian_energies"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A Newton step improves a root unless its shape is nearly orthogonal to itself: x^T x is then below this share of
# x^H x, which a mixture of the shapes of a repeated mode may cause.
_CANCELS = 0.01


class PencilBasis(NamedTuple):
    """Elastic shapes and damped rigid motions on which a damped system is projected.

    Parameters
    ----------
    V : (N, m) float64
        Elastic shapes with V^T K V = 1 and V^T M V = diag(root_mass^2).
    root_mass : (m,) float64
        1/w for an undamped mode; 0 for a shape without mass.
    damped_rigid : (N, b) float64
        Rigid motions, orthonormal in M and M-orthogonal to V; D between them is regular.
    coupled_rigid : (N, c) float64
        Other rigid motions, orthonormal and M-orthogonal too, which D couples to elastic motion alone, as gyroscopic
        forces do.
    """

    V: Real
    root_mass: Real
    damped_rigid: Real
    coupled_rigid: Real


class PencilRoots(NamedTuple):
    """Some roots by ascending magnitude, none with Im s < 0.

    Parameters
    ----------
    s : (k,) complex128
        Roots in rad/s.
    X : (N, k) complex128
        Their shapes.
    x : (m, k) complex128
        Amplitudes of the elastic shapes of the basis in X.
    Y : (N, k) complex128
        Left shapes, Y^T Z(s) = 0; those of symmetric matrices are X.
    y : (m, k) complex128
        Amplitudes of the elastic shapes of the basis in Y.
    """

    s: Complex
    X: Complex
    x: Complex
    Y: Complex
    y: Complex

    def chosen(self, some: NDArray[np.bool_] | NDArray[np.int64]) -> PencilRoots:
        """Some of the roots."""
        return PencilRoots(self.s[some], *(part[:, some] for part in self[1:]))

    def mirrored(self) -> PencilRoots:
        """The same roots with right and left shapes exchanged."""
        return PencilRoots(self.s, self.Y, self.y, self.X, self.x)


@dataclass(frozen=True, eq=False)
class DampedPencil:
    """A damped system: s^2 M x + s D x + (K + i loss) x = 0.

    Parameters
    ----------
    K, M : (N, N) Matrix
        Stiffness and mass, symmetric, positive semidefinite.
    D, loss : (N, N) Matrix, optional
        Viscous damping and the imaginary part of the stiffness, symmetric, positive semidefinite. D may have a skew
        part, that of gyroscopic forces, which do no work.
    """

    K: Matrix
    M: Matrix
    D: Matrix | None
    loss: Matrix | None

    @cached_property
    def gyroscopic(self) -> bool:
        """True if D has a skew part."""
        return is_gyroscopic(self.D)

    @property
    def N(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def residual(self, found: PencilRoots, KV: Real) -> Complex:
        """Residual of the equation for each root and shape (N, k).

        ``KV`` is K times the elastic shapes of the basis. For modes w^2 M V avoids the rounding of a product with a
        stiff K.
        """
        r = (self.M @ found.X) * found.s**2 + KV @ found.x
        if self.D is not None:
            r = r + (self.D @ found.X) * found.s
        if self.loss is not None:
            r = r + 1j * (self.loss @ found.X)
        return np.asarray(r)

    def transposed(self) -> DampedPencil:
        """The system whose shapes are the left shapes of this one."""
        D = self.D
        mirrored = sp.csc_array(D.T) if isinstance(D, sp.sparray) else None if D is None else np.asarray(D.T)
        return DampedPencil(self.K, self.M, mirrored, self.loss)

    def slope(self, found: PencilRoots) -> Real:
        """Slope x^H (2 |s| M + D) x of the equation over s for each shape (k,)."""
        slope = 2 * abs(found.s) * hermitian_energies(found.X, self.M)
        return slope if self.D is None else slope + hermitian_energies(found.X, self.D)

    def roots(self, basis: PencilBasis, omega: float) -> PencilRoots:
        """Roots with |s| up to ``omega`` rad/s in the span of a basis, one of each conjugate pair.

        Notes
        -----
        The eigenvalues are mu = 1/s, so that soft modes keep their digits and shapes without mass, mu = 0, drop out.
        Let S = diag(root_mass), y = s S x, v the velocities of damped rigid motions and E those of coupled ones over
        x. The root s = 0 of their positions is left out, and the momentum of coupled ones, v_c = -D_ce x, stiffens:
        C = (1 + D_ce^T D_ce + i loss)^-1, because D_ec = -D_ce^T where D_cc is zero.

            mu v = -D_rr^-1 (v + D_re x)
            mu x = C (D_er D_rr^-1 (v + D_re x) - D_ee x - S y)
            mu y = S x
        """
        S, b, m = basis.root_mass, basis.damped_rigid.shape[1], basis.root_mass.size
        K: Real | Complex = np.eye(m)
        if self.loss is not None:
            K = np.asarray(K + 1j * np.asarray(basis.V.T @ (self.loss @ basis.V)), dtype=np.complex128)
        coupling = np.zeros((basis.coupled_rigid.shape[1], m))
        if self.D is None:
            D = np.zeros((m, m))
            mu, x = _conservative(S, None if self.loss is None else np.asarray(la.inv(K), dtype=np.complex128))
            y = x
        else:
            both = np.hstack([basis.damped_rigid, basis.V])
            D = np.asarray(both.T @ (self.D @ both))
            coupling = np.asarray(basis.coupled_rigid.T @ (self.D @ basis.V))
            K = K + np.asarray(coupling.T @ coupling, dtype=K.dtype)
            mu, x, y = _eigenvalues(S, K, D, b, both_sides=self.gyroscopic)
        keep = (abs(mu) * omega >= 1) & (mu.imag <= 0)
        s, x, y = _sharpened(1 / mu[keep], x[:, keep], y[:, keep], S, D, K), x[:, keep], y[:, keep]
        V, momentum = np.hstack([basis.damped_rigid, basis.V]), basis.coupled_rigid @ coupling
        X, Y = V @ x - momentum @ (x[b:] / s), V @ y + momentum @ (y[b:] / s)
        order = np.argsort(abs(s), kind="stable")
        return PencilRoots(s, X, x[b:], Y, y[b:]).chosen(order)


def _conservative(S: Real, C: Complex | None) -> tuple[Complex, Complex]:
    """Eigenvalues 1/s and shapes without viscous damping, from s^2 and so at half the size."""
    if C is None:
        return -1j * S.astype(np.complex128), np.eye(S.size, dtype=np.complex128)
    nu, y = la.eig(S[:, None] * C * S)
    return -1j * np.sqrt(nu), C @ (S[:, None] * y)


def _eigenvalues(S: Real, K: Real | Complex, D: Real, b: int, *, both_sides: bool) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues of mu (v, x, y) in `DampedPencil.roots`, and right and left amplitudes of all motions (b + m, k)."""
    m = S.size
    D_er = D[b:, :b]
    by_rigid = la.solve(D[:b, :b], np.hstack([np.eye(b), D[:b, b:]])) if b else np.zeros((0, m))
    x_from = np.hstack([D_er @ by_rigid - np.hstack([np.zeros((m, b)), D[b:, b:]]), -np.diag(S)])
    P = np.vstack(
        [
            np.hstack([-by_rigid, np.zeros((b, m))]),
            la.solve(K, x_from),
            np.hstack([np.zeros((m, b)), np.diag(S), np.zeros((m, m))]),
        ]
    )
    if not both_sides:
        mu, states = la.eig(P)
        x = np.vstack([states[:b] * mu, states[b : b + m]])
        return mu, x, x
    mu, left, states = la.eig(P, left=True)
    x = np.vstack([states[:b] * mu, states[b : b + m]])
    # P = A^-1 B, and A^T turns left vectors of B - mu A into those of P.
    y_e = la.solve(K, left[b : b + m].conj())
    y_r = la.solve(D[:b, :b].T, left[:b].conj() - D_er.T @ y_e) if b else y_e[:0]
    return mu, x, np.vstack([y_r, y_e])


def _sharpened(s: Complex, x: Complex, y: Complex, S: Real, D: Real, K: Real | Complex) -> Complex:
    """Roots after a Newton step on y^T Z(s) x = 0, which squares the error that the shapes cause in their root."""
    b = D.shape[0] - S.size
    root = np.concatenate([np.ones(b), S])[:, None]
    mass = np.sum((root * y) * (root * x), axis=0)
    damping = np.einsum("ij,ij->j", y, D @ x)
    stiffness = np.einsum("ij,ij->j", y[b:], K @ x[b:])
    slope = 2 * s * mass + damping
    sizes = [
        2 * abs(s) * np.sum(abs(root * q) ** 2, axis=0) + np.einsum("ij,ij->j", q.conj(), D @ q).real for q in (x, y)
    ]
    sound = abs(slope) > _CANCELS * np.sqrt(sizes[0] * sizes[1])
    step = (s**2 * mass + s * damping + stiffness) / np.where(sound, slope, 1.0)
    return np.asarray(np.where(sound, s - step, s))


def hermitian_energies(X: Complex, A: Matrix) -> Real:
    """x^H A x of each column (k,)."""
    return np.asarray(np.einsum("ij,ij->j", X.conj(), np.asarray(A @ X)).real)
