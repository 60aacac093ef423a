"""Complex modes of a damped system: all roots up to a frequency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.damped_pencil import Basis, DampedPencil, Roots, energy
from cmsreduce.linalg.dense import dense
from cmsreduce.linalg.factorise import factorise
from cmsreduce.linalg.pencil import elastic_and_massless

__all__ = ["ALL_ROOTS_LIMIT", "ComplexModes", "complex_modes"]

ALL_ROOTS_LIMIT = 150
"""Coordinates up to which all roots at once, by dense algebra on twice as many, are the quickest way to some."""

# A root is accepted when what the basis leaves out would move it by less than this share of its decay rate.
_ACCURACY = 1e-7
# A decay rate below this share of the frequency is next to none, and is known to a share of this one instead.
_NEXT_TO_NONE = 1e-6
# A direction whose energy is this share of what is left to gain is not worth a coordinate.
_SPARED = 0.1
# Rounds in which the basis grows: discrete dampers take 8, dampers that lock half of a body 12.
_ROUNDS = 20
# The load that residuals are answered at grows at this share of the highest frequency: nearer to zero the answer suits
# light damping better, further away damping that outdoes the stiffness.
_GROWTH = 0.3
# Damping that leaves more than this share of itself on rigid motion brakes it; round-off of a projection leaves less.
_BRAKED = 1e-9

Real = NDArray[np.float64]


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
        Real roots of overdamped modes and of braked rigid motions, by ascending magnitude; of a large system those that
        are as well known as the others.
    """

    s: NDArray[np.complex128]
    X: NDArray[np.complex128]
    real: NDArray[np.float64]

    @property
    def omega(self) -> Real:
        """Natural frequencies |s| in rad/s."""
        return np.asarray(abs(self.s))

    @property
    def zeta(self) -> Real:
        """Damping ratios -Re s / |s|."""
        return np.asarray(-self.s.real / abs(self.s))


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
        Motions on which K and loss vanish, orthonormal in M. Their roots s = 0 are left out; where D brakes them,
        their other root is among the real ones.
    undamped : ((k,), (N, k)) float64, optional
        Elastic modes without damping, frequencies in rad/s and shapes orthonormal in M, to a little above ``omega``:
        where the search starts in a system of more than `ALL_ROOTS_LIMIT` coordinates; a smaller one needs none.
    rounding : float
        Relative rounding of the entries of M, where they are printed with few digits.

    Raises
    ------
    MatrixError
        If the roots of a large system do not settle.

    Notes
    -----
    The basis of a large system grows by t = Z(a)^-1 r, a > 0, for the residual r = Z(s) x of each oscillating root,
    until r^H t / x^H (2 |s| M + D) x, what r would still move s by, is a small share of the decay rate: the matrices
    are symmetric, so that the left shape is the right one and the error of s is of second order in that of x. No mode
    hides outside of the first basis: with viscous damping |s|^2 = x^H K x / x^H M x, so that most of an oscillating
    shape is made of undamped modes not far above it.
    """
    braked = _braked(pencil, rigid)
    if pencil.N <= ALL_ROOTS_LIMIT:
        found = pencil.roots(Basis(*_all_shapes(pencil, rigid, rounding), braked), omega)
    elif undamped is None:
        raise MatrixError(f"a system of {pencil.N} coordinates needs its undamped modes as a start for the damped ones")
    else:
        found = _settled(pencil, Basis(undamped[1] / undamped[0], 1 / undamped[0], braked), rigid, omega)
    oscillates = found.s.imag > 0
    X = found.X[:, oscillates]
    return ComplexModes(found.s[oscillates], X / np.sqrt(energy(X, pencil.M)), found.s[~oscillates].real)


def _braked(pencil: DampedPencil, rigid: Real) -> Real:
    """Rigid motions that are not free of D, orthonormal in M and orthogonal in D."""
    if pencil.D is None or not rigid.shape[1]:
        return rigid[:, :0]
    drag, Y = la.eigh(rigid.T @ (pencil.D @ rigid))
    motions = rigid @ Y
    size = spla.norm(sp.csc_array(pencil.D), 1) * np.sum(motions**2, axis=0)
    return np.asarray(motions[:, drag > _BRAKED * size])


def _all_shapes(pencil: DampedPencil, rigid: Real, rounding: float) -> tuple[Real, Real]:
    """Every elastic shape of a small system, those without mass last, and the roots of their masses."""
    lam, X, N = elastic_and_massless(dense(pencil.K), dense(pencil.M), rigid, rounding)
    return np.hstack([X / np.sqrt(lam), N]), np.append(1 / np.sqrt(lam), np.zeros(N.shape[1]))


def _settled(pencil: DampedPencil, start: Basis, rigid: Real, omega: float) -> Roots:
    """Roots in a basis that grows until no oscillating one moves any more, and those real ones that do not either."""
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
        allowed = _ACCURACY * np.maximum(-found.s.real, _NEXT_TO_NONE * abs(found.s)) * pencil.slope(found)
        settled = left <= allowed
        moving = ~settled & (found.s.imag > 0)
        if not moving.any():
            return Roots(found.s[settled], found.X[:, settled], found.x[:, settled])
        more = t[:, moving] / np.sqrt(allowed[moving])
        more = np.hstack([more.real, more.imag])
        for _ in range(2):
            more -= rigid @ (momentum.T @ more)
            more -= basis.V @ (KV.T @ more)
        grown, root_mass = _grown(pencil, grown, more)
        basis = Basis(np.hstack([start.V, grown]), np.append(start.root_mass, root_mass), start.braked)
        KV = np.hstack([start_KV, np.asarray(pencil.K @ grown)])
    worst = int(np.argmax(np.where(moving, left / allowed, 0.0)))
    raise MatrixError(
        f"the complex mode at {abs(found.s[worst]) / 2 / np.pi:.6g} Hz did not settle in {_ROUNDS} rounds: it is known "
        f"to {_ACCURACY * left[worst] / allowed[worst]:.1e} of its decay rate. Check the damping matrix for entries "
        "far beyond stiffness over frequency"
    )


def _grown(pencil: DampedPencil, grown: Real, more: Real) -> tuple[Real, Real]:
    """Shapes with those of ``more`` that are worth it, orthonormal in K and orthogonal in M; roots of their masses."""
    gain, Y = la.eigh(more.T @ (pencil.K @ more))
    worth = gain > _SPARED
    grown = np.hstack([grown, more @ (Y[:, worth] / np.sqrt(gain[worth]))])
    mass, Y = la.eigh(grown.T @ (pencil.M @ grown))
    return grown @ Y, np.sqrt(np.maximum(mass, 0.0))


def _solver(pencil: DampedPencil, omega: float) -> Callable[[Real], Real]:
    """Solve with Z(s) of a positive s: real and definite, whatever the damping and the rigid motions."""
    s = _GROWTH * omega
    Z = pencil.K + s**2 * pencil.M
    if pencil.D is not None:
        Z = Z + s * pencil.D
    if sp.issparse(Z):
        return factorise(sp.csc_array(Z), what="the system at a load that grows")
    factor = la.cho_factor(np.asarray(Z))
    return lambda b: np.asarray(la.cho_solve(factor, b))
