"""Zeros of the response between an actuator and a sensor, which feedback drives the poles to."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

__all__ = ["transmission_zeros", "visible_modes", "zero_shifts"]

Array = NDArray[np.float64]

# Eigenvalues of the pencil beyond this many times the highest pole are at infinity: a channel has one for each
# derivative that it lacks.
_INFINITE = 1e4
# A mode with less than this share of the largest c b has its zero as close to its pole, relative: they cancel.
_INVISIBLE = 1e-6
# Modes this close are one pole, whose parts add up or cancel.
_ONE_POLE = 1e-9


def transmission_zeros(
    omega: Array, b: Array, c: Array, zeta: Array | None = None, *, rate: bool = False, static: float = 0.0
) -> NDArray[np.complex128]:
    """Zeros of c (s^2 + 2 zeta w s + w^2)^-1 b + static, modes of unit modal mass.

    Parameters
    ----------
    omega : (k,) float64
        Frequencies in rad/s, 0 of rigid modes.
    b, c : (k,) float64
        Modal input and output of one pair of channels.
    zeta : (k,) float64, optional
        Damping ratios; none by default.
    rate : bool
        Whether the output is a rate, which adds a zero at s = 0.
    static : float
        Gain of static modes.

    Returns
    -------
    (z,) complex128
        In rad/s, those of positive imaginary part and those on the real axis, by magnitude. Of an undamped collocated
        pair they lie on the imaginary axis, between the poles.

    Notes
    -----
    Generalised eigenvalues of Rosenbrock's pencil (Emami-Naeini, Van Dooren 1982), frequencies in units of the highest.
    """
    k, size = omega.size, float(omega.max(initial=0.0)) or 1.0
    w, damping = omega / size, np.zeros(omega.size) if zeta is None else zeta
    # Channels of order one: the pencil's entries are compared with each other.
    gb, gc = float(abs(b).max(initial=0.0)) or 1.0, float(abs(c).max(initial=0.0)) or 1.0
    A = np.zeros((2 * k + 1, 2 * k + 1))
    A[:k, k : 2 * k] = np.eye(k)
    A[k : 2 * k, :k], A[k : 2 * k, k : 2 * k] = -np.diag(w**2), -np.diag(2 * damping * w)
    A[k : 2 * k, -1] = b / gb
    A[-1, slice(k, 2 * k) if rate else slice(0, k)] = c / gc
    A[-1, -1] = static * size**2 / (gb * gc)
    E = np.diag(np.r_[np.ones(2 * k), 0.0])
    alpha, beta = la.eigvals(A, E, homogeneous_eigvals=True)
    finite = abs(alpha) < _INFINITE * abs(beta)
    zeros = size * alpha[finite] / beta[finite]
    upper = zeros[zeros.imag >= 0]
    return np.asarray(upper[np.argsort(abs(upper))], dtype=np.complex128)


def visible_modes(omega: Array, residue: Array) -> tuple[Array, Array]:
    """Poles that one pair of channels sees: modes of one frequency as one, those that cancel left out.

    Parameters
    ----------
    omega : (k,) float64
        Frequencies in rad/s, ascending, 0 of rigid modes.
    residue : (k,) float64
        c b of each mode.

    Returns
    -------
    omega, residue : (v,) float64
    """
    if not omega.size:
        return omega, residue
    group = np.concatenate([[0], np.cumsum(np.diff(omega) > _ONE_POLE * omega[1:])]).astype(np.int64)
    total = np.bincount(group, weights=residue)
    first = omega[np.unique(group, return_index=True)[1]]
    seen = abs(total) > _INVISIBLE * abs(total).max(initial=0.0)
    return first[seen], total[seen]


def zero_shifts(
    full: NDArray[np.complex128],
    reduced: NDArray[np.complex128],
    band: tuple[float, float],
    poles: Array | None = None,
    hidden: float = 0.0,
) -> Array:
    """How far the zeros of a full system in a band are from those of a reduced one.

    Parameters
    ----------
    full, reduced : (z,), (y,) complex128
        In rad/s.
    band : (float, float)
        Frequencies of interest in rad/s.
    poles : (k,) float64, optional
        Frequencies of the full system in rad/s.
    hidden : float
        Zeros nearer to a pole than this, relative, are left out: damping as large hides the pair, and a reduced model
        may do without either.

    Returns
    -------
    (m,) float64
        |z_r - z| / |z| of every zero that is left, paired one to one as closely as can be; infinite where the reduced
        system has none.
    """
    size = abs(full)
    inside = full[(size >= band[0]) & (size <= band[1]) & (size > 0)]
    if poles is not None and poles.size and inside.size:
        near = (abs(abs(inside)[:, None] - poles[None, :]) / abs(inside)[:, None]).min(axis=1)
        inside = inside[near > hidden]
    if not inside.size:
        return np.empty(0)
    distance = abs(reduced[None, :] - inside[:, None]) / abs(inside)[:, None]
    i, j = linear_sum_assignment(distance)
    shifts = np.full(inside.size, np.inf)
    shifts[i] = distance[i, j]
    return shifts
