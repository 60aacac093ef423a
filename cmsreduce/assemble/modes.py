"""Modes of an assembled system: undamped, damped, and under feedback from its sensors to its actuators."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import (
    UNRESISTED,
    ComplexModes,
    DampedPencil,
    UndeterminedError,
    complex_modes,
    elastic_pairs,
    energy_parts,
    modes_below,
)
from cmsreduce.model import REPEATED, System, error_of_sum

__all__ = ["check_closed_loop", "closed_loop_modes", "damped_modes", "system_modes", "undetermined"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Larger dense systems have their modes to a frequency computed alone: all of them take fifteen times as long at 1900
# coordinates.
_SMALL = 600
# The state matrix has (2 N)^2 entries, and all of its eigenvalues are computed.
_LARGEST = 1500
# A root of this size, relative to the highest frequency, is rigid motion that no feedback holds: as a double root of
# zero it is known to the root of rounding only.
_AT_REST = 1e-6
# Newton's step on a root is trusted up to this share of it; a larger one belongs to a multiple root, which has none.
_TRUSTED = 1e-3
# Each step squares the error, of 1e-6 at most to begin with.
_STEPS = 2


def system_modes(system: System, omega: float) -> tuple[Real, Real]:
    """Elastic modes of a system up to a frequency; its rigid modes are ``system.rigid``.

    Parameters
    ----------
    system : System
        Sparse or dense.
    omega : float
        Highest frequency in rad/s.

    Returns
    -------
    w : (k,) float64
        Undamped natural frequencies in rad/s, ascending.
    Phi : (N, k) float64
        Modes, orthonormal in M.

    Raises
    ------
    MatrixError
        If a motion has neither mass nor stiffness.
    """
    # The modes of a repeated frequency belong together, on whichever side of the limit rounding leaves each.
    highest = omega * (1 + REPEATED)
    try:
        if sp.issparse(system.K):
            return modes_below(system.K, sp.csc_array(system.M), omega, rigid=system.rigid, rounding=system.rounding)
        found = _lowest(system, highest) if system.N > _SMALL and 0 < omega < np.inf else None
        if found is None:
            found = elastic_pairs(np.asarray(system.K), np.asarray(system.M), system.rigid, system.rounding)
    except UndeterminedError as error:
        raise undetermined(system, error) from None
    lam, X = found
    keep = lam <= highest**2
    return np.sqrt(lam[keep]), X[:, keep]


def _lowest(system: System, omega: float) -> tuple[Real, Real] | None:
    """Squared frequencies and modes of a dense system up to a frequency, orthogonal in M to its rigid modes.

    Those of M x = mu (K + omega^2 M) x with the largest mu have all digits; a coordinate may be without mass. None if
    the solver of all modes has to tell a soft mode from a mechanism, or to name what is wrong.
    """
    K, M, R = np.asarray(system.K), np.asarray(system.M), system.rigid
    # Without the forces that rounding leaves in rigid motions: these are then exact, and so is what is orthogonal.
    MR, force = M @ R, K @ R
    coupled = (force - 0.5 * MR @ (R.T @ force)) @ MR.T
    K, least = K - coupled - coupled.T, (1 - REPEATED) / (2 * omega**2)
    try:
        V = la.eigh(M, K + omega**2 * M, subset_by_value=(least, np.inf), driver="gvx")[1]
        lam, Y = elastic_pairs(V.T @ K @ V, V.T @ M @ V, omega**2 * V.T @ MR, system.rounding)
    except (la.LinAlgError, MatrixError):
        return None
    X = V @ Y
    soft = lam <= max(UNRESISTED, error_of_sum(system.rounding)) * energy_parts(K, X)
    return None if soft.any() else (lam, X)


def undetermined(system: System, error: UndeterminedError) -> UndeterminedError:
    """Name the body that moves most in a motion with neither mass nor stiffness."""
    moved = np.split(abs(np.asarray(system.T @ error.shape)), np.cumsum(list(system.sizes.values()))[:-1])
    body = max(zip(system.sizes, moved, strict=True), key=lambda part: part[1].max(initial=0.0))[0]
    return UndeterminedError(
        f"in configuration '{system.configuration.name}' a motion, above all of body '{body}', has neither mass nor "
        "stiffness, so that nothing determines it: two points without mass are joined to each other alone. Give one of "
        "them a mass or a spring, or leave its dof out of the joint",
        error.shape,
    )


def damped_modes(system: System, omega: float, undamped: tuple[Real, Real]) -> ComplexModes | None:
    """Complex modes of a system up to a frequency, with its full damping and not the diagonal in the modes.

    Parameters
    ----------
    system : System
        Sparse or dense.
    omega : float
        Highest frequency |s| in rad/s.
    undamped : ((k,), (N, k)) float64
        Modes of the system without damping to a little above ``omega``, from `system_modes`.

    Returns
    -------
    ComplexModes or None
        None for a system without damping.

    Raises
    ------
    MatrixError
        As in `complex_modes`.
    """
    if system.D is None and system.loss is None:
        return None
    pencil = DampedPencil(system.K, system.M, system.D, system.loss)
    return complex_modes(pencil, omega, system.rigid, undamped, system.rounding)


def closed_loop_modes(
    system: System, gain: Real, omega: float, undamped: tuple[Real, Real] | None = None
) -> tuple[Complex, Complex]:
    """Roots and shapes of M x'' + D x' + K x = B u with u = -gain y, y = C1 x + C2 x'.

    Parameters
    ----------
    system : System
        Reduced; every coordinate has mass.
    gain : (inputs, outputs) float64
        Feedback gain; zeros for the damped modes of the system without feedback.
    omega : float
        Roots up to this size in rad/s are returned, without those of rigid motion at rest.
    undamped : ((e,), (N, e)) float64, optional
        All elastic modes of the system without damping or feedback, frequencies in rad/s and shapes orthonormal in M,
        if known.

    Returns
    -------
    s : (k,) complex128
        Roots in rad/s by size, one of each conjugate pair, the one above the real axis.
    X : (N, k) complex128
        Displacements, x(t) = X exp(s t), x^H M x = 1.

    Raises
    ------
    MatrixError
        If the system is too large for a dense state matrix, has massless coordinates, or a complex stiffness.

    Notes
    -----
    The equations are solved in the undamped modes, in which the stiffness is diagonal, so that soft motions keep their
    digits beside stiff ones; each root is then refined separately.
    """
    check_closed_loop(system)
    n = system.N
    if undamped is None:
        lam, Phi = elastic_pairs(dense(system.K), dense(system.M), system.rigid, system.rounding)
        undamped = np.sqrt(lam), Phi
    L = np.hstack([system.rigid, undamped[1]])
    if L.shape[1] < n:
        raise MatrixError(
            "modes under feedback need a mass for every coordinate, but static modes have none: use a mode set without "
            "them, or no feedback"
        )
    w = np.concatenate([np.zeros(system.rigid.shape[1]), undamped[0]])
    B = L.T @ system.B
    stiff = np.diag(w**2) + B @ gain @ (system.C1 @ L)
    damped = B @ gain @ (system.C2 @ L) + (0.0 if system.D is None else L.T @ dense(system.D) @ L)
    # Rates are in units of the highest frequency, so that both halves of the state have one size.
    A = np.block([[np.zeros((n, n)), omega * np.eye(n)], [-stiff / omega, -damped]])
    s, Z = la.eig(A)
    chosen = np.flatnonzero((abs(s) <= omega) & (abs(s) > _AT_REST * omega) & (s.imag >= 0))
    found = [_improved(s[k], Z[:n, k], w, stiff, damped) for k in chosen]
    found.sort(key=lambda pair: abs(pair[0]))
    X = np.column_stack([shape / np.linalg.norm(shape) for _, shape in found]) if found else np.zeros((n, 0))
    return np.array([root for root, _ in found], dtype=np.complex128), np.asarray(L @ X, dtype=np.complex128)


def check_closed_loop(system: System) -> None:
    """Refuse a system whose closed-loop modes cannot be computed, before other work starts.

    Raises
    ------
    MatrixError
        If the system is too large for a dense state matrix, or has a complex stiffness.
    """
    if system.N > _LARGEST:
        raise MatrixError(
            f"modes under feedback need a reduced system; this one has {system.N} coordinates, more than {_LARGEST}: "
            "use `of: reduced`, or fewer modes of the bodies"
        )
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no modes in time; use modal damping")


def _improved(s: complex, x: Complex, w: Real, stiff: Real, damped: Real) -> tuple[complex, Complex]:
    """Refine a root and its shape by Newton's steps on (s^2 + s damped + stiff) x = 0, x of fixed length."""
    unit = 1 / np.maximum(w, abs(s))
    both = np.outer(unit, unit)
    first, y = s, x / unit
    for _ in range(_STEPS):
        slope = both * (damped + 2 * s * np.eye(w.size))
        T = both * (stiff + s * damped + s**2 * np.eye(w.size))
        border = np.block([[T, (slope @ y)[:, None]], [y.conj()[None], np.zeros((1, 1))]])
        step = la.solve(border, np.append(-T @ y, 0.0))
        if not abs(step[-1]) <= _TRUSTED * abs(first):
            return first, x
        s, y = s + step[-1], y + step[:-1]
    return s, unit * y
