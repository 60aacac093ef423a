"""Complex modes: roots of s^2 M + s D + K + i loss up to a frequency, and their shapes.

The roots of a small system are computed all at once by dense algebra. In a large system a basis grows until the roots
no longer change.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen.pencil import elastic_and_massless
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import Matrix

__all__ = ["ALL_ROOTS_LIMIT", "ComplexModes", "DampedPencil", "complex_modes"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

ALL_ROOTS_LIMIT = 150
"""Largest number of coordinates at which dense algebra, of twice the size, is the quickest way to some roots."""
# A Newton step improves a root unless its shape is nearly orthogonal to itself: x^T x is then below this share of
# x^H x, which a mixture of the shapes of a repeated mode may cause.
_CANCELS = 0.01
# A root is accepted when the residual would move it by less than this share of its decay rate.
_ACCURACY = 1e-7
# A decay rate below this share of the frequency counts as this share, so that the accuracy asked for stays finite.
_LEAST_DECAY = 1e-6
# A shape is added to the basis if its energy exceeds this share of the error that is allowed.
_WORTHWHILE = 0.1
# Rounds in which the basis grows: discrete dampers take 8, dampers that lock half of a body 12.
_ROUNDS = 20
# Growth rate s of the load whose responses extend the basis, as a share of the highest frequency. A smaller rate suits
# light damping, a larger one damping forces that exceed the stiffness forces.
_GROWTH = 0.3
# Damping acts on a rigid motion if more than this share of its terms is left there; round-off leaves less.
_DAMPED = 1e-9


class _Basis(NamedTuple):
    """Elastic shapes and damped rigid motions on which a damped system is projected.

    Parameters
    ----------
    V : (N, m) float64
        Elastic shapes with V^T K V = 1 and V^T M V = diag(root_mass^2).
    root_mass : (m,) float64
        1/w for an undamped mode; 0 for a shape without mass.
    damped_rigid : (N, b) float64
        Rigid motions, orthonormal in M and M-orthogonal to V; D is diagonal and positive on them.
    """

    V: Real
    root_mass: Real
    damped_rigid: Real


class _Roots(NamedTuple):
    """Some roots by ascending magnitude, none with Im s < 0.

    Parameters
    ----------
    s : (k,) complex128
        Roots in rad/s.
    X : (N, k) complex128
        Their shapes.
    x : (m, k) complex128
        Amplitudes of the elastic shapes of the basis in X.
    """

    s: Complex
    X: Complex
    x: Complex


@dataclass(frozen=True, eq=False)
class ComplexModes:
    """Roots of a damped system up to a frequency; of each conjugate pair the one with Im s > 0.

    Parameters
    ----------
    s : (k,) complex128
        Roots -zeta w + i w sqrt(1 - zeta^2) in rad/s, by ascending w = |s|.
    X : (N, k) complex128
        Shapes, of unit length in M.
    real : (q,) float64
        Real roots of overdamped modes and of damped rigid motions, by ascending magnitude. For a large system only
        those as accurate as ``s``.
    """

    s: Complex
    X: Complex
    real: Real

    @property
    def omega(self) -> Real:
        """Natural frequencies |s| in rad/s."""
        return np.asarray(abs(self.s))

    @property
    def zeta(self) -> Real:
        """Damping ratios -Re s / |s|."""
        return np.asarray(-self.s.real / abs(self.s))


@dataclass(frozen=True, eq=False)
class DampedPencil:
    """A damped system: s^2 M x + s D x + (K + i loss) x = 0.

    Parameters
    ----------
    K, M : (N, N) Matrix
        Stiffness and mass, symmetric, positive semidefinite.
    D, loss : (N, N) Matrix, optional
        Viscous damping and the imaginary part of the stiffness, symmetric, positive semidefinite.
    """

    K: Matrix
    M: Matrix
    D: Matrix | None
    loss: Matrix | None

    @property
    def N(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def residual(self, found: _Roots, KV: Real) -> Complex:
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

    def slope(self, found: _Roots) -> Real:
        """Slope x^H (2 |s| M + D) x of the equation over s for each shape (k,)."""
        slope = 2 * abs(found.s) * _energy(found.X, self.M)
        return slope if self.D is None else slope + _energy(found.X, self.D)

    def roots(self, basis: _Basis, omega: float) -> _Roots:
        """Roots with |s| up to ``omega`` rad/s in the span of a basis, one of each conjugate pair.

        Notes
        -----
        The eigenvalues are mu = 1/s, so that soft modes keep their digits and shapes without mass, mu = 0, drop out.
        Let S = diag(root_mass), y = s S x, C = (1 + i loss)^-1 and v the velocities of damped rigid motions. The root
        s = 0 of their positions is left out:

            mu v = -D_rr^-1 (v + D_re x)
            mu x = C (D_er D_rr^-1 (v + D_re x) - D_ee x - S y)
            mu y = S x
        """
        S, b, m = basis.root_mass, basis.damped_rigid.shape[1], basis.root_mass.size
        L = None if self.loss is None else np.asarray(basis.V.T @ (self.loss @ basis.V))
        C = None if L is None else np.asarray(la.inv(np.eye(m) + 1j * L), dtype=np.complex128)
        if self.D is None:
            D = np.zeros((m, m))
            mu, x = _conservative(S, C)
            v = np.empty((0, mu.size), dtype=np.complex128)
        else:
            both = np.hstack([basis.damped_rigid, basis.V])
            D = np.asarray(both.T @ (self.D @ both))
            mu, states = la.eig(_inverse_pencil(S, C, D, b))
            v, x = (np.asarray(part, dtype=np.complex128) for part in (states[:b], states[b : b + m]))
        keep = (abs(mu) * omega >= 1) & (mu.imag <= 0)
        s, v, x = 1 / mu[keep], v[:, keep], x[:, keep]
        s = _sharpened(s, v, x, S, D, L)
        order = np.argsort(abs(s), kind="stable")
        X = basis.V @ x + basis.damped_rigid @ (v / s)
        return _Roots(s[order], X[:, order], x[:, order])


def complex_modes(
    pencil: DampedPencil,
    omega: float,
    rigid: Real,
    undamped: tuple[Real, Real] | None = None,
    rounding: float = 2.0**-53,
) -> ComplexModes:
    """All complex modes up to a frequency.

    Parameters
    ----------
    pencil : DampedPencil
        Dense or sparse.
    omega : float
        Highest frequency |s| in rad/s.
    rigid : (N, R) float64
        Motions on which K and loss vanish, orthonormal in M. Their roots s = 0 are left out. If D damps a motion, its
        other root is among the real ones.
    undamped : ((k,), (N, k)) float64, optional
        Elastic modes without damping up to a little above ``omega``: frequencies in rad/s and shapes orthonormal in M.
        The search starts from them. A system of at most `ALL_ROOTS_LIMIT` coordinates needs none.
    rounding : float
        Relative rounding of the entries of M, for a file of few digits.

    Raises
    ------
    MatrixError
        If the roots of a large system do not settle, or its undamped modes are not given.

    Notes
    -----
    The basis of a large system grows by t = Z(a)^-1 r, a > 0, for the residual r = Z(s) x of each oscillating root. It
    is complete when r^H t / x^H (2 |s| M + D) x, the change of s that r would cause, is a small share of the decay
    rate. The matrices are symmetric, so that left and right shapes are equal and the error of s is of second order in
    the error of x. The first basis contains a part of every mode: with viscous damping |s|^2 = x^H K x / x^H M x, so
    that an oscillating shape consists mainly of undamped modes up to a little above |s|.
    """
    damped_rigid = _damped_rigid(pencil, rigid)
    if pencil.N <= ALL_ROOTS_LIMIT:
        lam, V, N = elastic_and_massless(dense(pencil.K), dense(pencil.M), rigid, rounding)
        root_mass = np.append(1 / np.sqrt(lam), np.zeros(N.shape[1]))
        found = pencil.roots(_Basis(np.hstack([V / np.sqrt(lam), N]), root_mass, damped_rigid), omega)
    elif undamped is None:
        raise MatrixError(f"a system of {pencil.N} coordinates needs its undamped modes as a start for the damped ones")
    else:
        found = _settled(pencil, _Basis(undamped[1] / undamped[0], 1 / undamped[0], damped_rigid), rigid, omega)
    oscillates = found.s.imag > 0
    X = found.X[:, oscillates]
    return ComplexModes(found.s[oscillates], X / np.sqrt(_energy(X, pencil.M)), found.s[~oscillates].real)


def _damped_rigid(pencil: DampedPencil, rigid: Real) -> Real:
    """Rigid motions that D damps, orthonormal in M and orthogonal in D."""
    if pencil.D is None or not rigid.shape[1]:
        return rigid[:, :0]
    drag, Y = la.eigh(rigid.T @ (pencil.D @ rigid))
    motions = rigid @ Y
    size = spla.norm(sp.csc_array(pencil.D), 1) * np.sum(motions**2, axis=0)
    return np.asarray(motions[:, drag > _DAMPED * size])


def _settled(pencil: DampedPencil, start: _Basis, rigid: Real, omega: float) -> _Roots:
    """Roots in a basis that grows until all oscillating roots settle, and the real roots that have settled too."""
    solve, momentum = _solver(pencil, omega), np.asarray(pencil.M @ rigid)
    start_KV = np.asarray(pencil.M @ start.V) / start.root_mass**2
    basis, KV, grown = start, start_KV, start.V[:, :0]
    for _ in range(_ROUNDS):
        found = pencil.roots(basis, omega)
        r = pencil.residual(found, KV)
        r -= momentum @ (rigid.T @ r)
        t = solve(np.hstack([r.real, r.imag]))
        t = t[:, : found.s.size] + 1j * t[:, found.s.size :]
        left = abs(np.einsum("ij,ij->j", r.conj(), t))
        allowed = _ACCURACY * np.maximum(-found.s.real, _LEAST_DECAY * abs(found.s)) * pencil.slope(found)
        settled = left <= allowed
        moving = ~settled & (found.s.imag > 0)
        if not moving.any():
            return _Roots(found.s[settled], found.X[:, settled], found.x[:, settled])
        more = t[:, moving] / np.sqrt(allowed[moving])
        more = np.hstack([more.real, more.imag])
        for _ in range(2):
            more -= rigid @ (momentum.T @ more)
            more -= basis.V @ (KV.T @ more)
        grown, root_mass = _grown(pencil, grown, more)
        basis = _Basis(np.hstack([start.V, grown]), np.append(start.root_mass, root_mass), start.damped_rigid)
        KV = np.hstack([start_KV, np.asarray(pencil.K @ grown)])
    worst = int(np.argmax(np.where(moving, left / allowed, 0.0)))
    raise MatrixError(
        f"the complex mode at {abs(found.s[worst]) / 2 / np.pi:.6g} Hz did not settle in {_ROUNDS} rounds: it is known "
        f"to {_ACCURACY * left[worst] / allowed[worst]:.1e} of its decay rate. Check the damping matrix for entries "
        "much larger than stiffness over frequency"
    )


def _grown(pencil: DampedPencil, grown: Real, more: Real) -> tuple[Real, Real]:
    """Shapes with the worthwhile part of ``more``, orthonormal in K, orthogonal in M, and roots of their masses."""
    gain, Y = la.eigh(more.T @ (pencil.K @ more))
    worth = gain > _WORTHWHILE
    grown = np.hstack([grown, more @ (Y[:, worth] / np.sqrt(gain[worth]))])
    mass, Y = la.eigh(grown.T @ (pencil.M @ grown))
    return grown @ Y, np.sqrt(np.maximum(mass, 0.0))


def _solver(pencil: DampedPencil, omega: float) -> Callable[[Real], Real]:
    """Solve with Z(s) for a positive s, where Z is real and definite for any damping and rigid motions."""
    s = _GROWTH * omega
    Z = pencil.K + s**2 * pencil.M
    if pencil.D is not None:
        Z = Z + s * pencil.D
    if sp.issparse(Z):
        return factorise(sp.csc_array(Z), what="the system under a growing load")
    factor = la.cho_factor(np.asarray(Z))
    return lambda b: np.asarray(la.cho_solve(factor, b))


def _conservative(S: Real, C: Complex | None) -> tuple[Complex, Complex]:
    """Eigenvalues 1/s and shapes without viscous damping, from s^2 and so at half the size."""
    if C is None:
        return -1j * S.astype(np.complex128), np.eye(S.size, dtype=np.complex128)
    nu, y = la.eig(S[:, None] * C * S)
    return -1j * np.sqrt(nu), C @ (S[:, None] * y)


def _inverse_pencil(S: Real, C: Complex | None, D: Real, b: int) -> Real | Complex:
    """Matrix of mu (v, x, y) in `DampedPencil.roots`."""
    m = S.size
    coupling = D[:b, b:] / D[:b, :b].diagonal()[:, None]
    x_from = np.hstack([coupling.T, coupling.T @ D[:b, b:] - D[b:, b:], -np.diag(S)])
    rows = [
        np.hstack([-np.diag(1 / D[:b, :b].diagonal()), -coupling, np.zeros((b, m))]),
        x_from if C is None else C @ x_from,
        np.hstack([np.zeros((m, b)), np.diag(S), np.zeros((m, m))]),
    ]
    return np.vstack(rows)


def _sharpened(s: Complex, v: Complex, x: Complex, S: Real, D: Real, L: Real | None) -> Complex:
    """Roots after a Newton step on q^T Z(s) q = 0, which squares the error that a shape q causes in its root."""
    q = np.vstack([v / s, x])
    mass = np.sum((v / s) ** 2, axis=0) + np.sum((S[:, None] * x) ** 2, axis=0)
    damping = np.einsum("ij,ij->j", q, D @ q)
    stiffness = np.sum(x**2, axis=0) + (0 if L is None else 1j * np.einsum("ij,ij->j", x, L @ x))
    slope = 2 * s * mass + damping
    length = np.sum(abs(v / s) ** 2, axis=0) + np.sum(abs(S[:, None] * x) ** 2, axis=0)
    sound = abs(slope) > _CANCELS * (2 * abs(s) * length + np.einsum("ij,ij->j", q.conj(), D @ q).real)
    step = (s**2 * mass + s * damping + stiffness) / np.where(sound, slope, 1.0)
    return np.asarray(np.where(sound, s - step, s))


def _energy(X: Complex, A: Matrix) -> Real:
    """x^H A x of each column (k,)."""
    return np.asarray(np.einsum("ij,ij->j", X.conj(), np.asarray(A @ X)).real)
