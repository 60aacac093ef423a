"""Zeros of the response between an actuator and a sensor, to which feedback drives the poles."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.verify.mode_pairing import closest_pairs

__all__ = ["judged_zeros", "visible_modes", "zero_shifts", "zeros_below"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A mode with less than this share of the response of the others at its frequency has its zero as close to its pole,
# relative: they cancel.
_INVISIBLE = 1e-6
# Modes this close are one pole, whose parts add up or cancel.
_ONE_POLE = 1e-9
# Modes above this many times the highest zero wanted enter by a power series in (w_zero / w)^2. It is cut off where the
# remainder is 4^-14 = 4e-9 of their static part.
_FAR, _TERMS = 2.0, 14
# Zeros up to this many times the highest one wanted are returned, too.
_BEYOND = 1.2
# A root whose numerator and denominator are both below this share of the pencil is not determined by it.
_UNDETERMINED = 1e-14
# A root with less than this share of its size off the real axis is on the axis.
_ON_AXIS = 1e-7
# An error moves a double zero off the axis, or along it, by its root. A zero with less than this share of
# its size off the axis is returned with all its mirror images, as many as two zeros on the axis have.
_NEAR_AXIS = 1e-2
# Zeros whose magnitudes differ by less than this share may be mirror images, which rounding puts in any order.
_ALIKE = 1e-6


def zeros_below(omega: Array, residue: Array, omega_max: float, *, static: float = 0.0) -> Complex:
    """Find all undamped zeros of sum residue / (s^2 + w^2) + static up to a frequency.

    Parameters
    ----------
    omega : (k,) float64
        Frequencies in rad/s, 0 of rigid modes; all different.
    residue : (k,) float64
        c b of each.
    omega_max : float
        Highest frequency of interest in rad/s.
    static : float
        Gain of static modes.

    Returns
    -------
    (z,) complex128
        In rad/s up to a little above ``omega_max``, by magnitude: zeros of positive imaginary part and all zeros on or
        near the real axis. The right one of two mirror images comes first. Zeros of a collocated pair lie on the
        imaginary axis, between the poles. A response that is nothing has none.

    Notes
    -----
    Rosenbrock's pencil (Emami-Naeini, Van Dooren 1982) in lambda = s^2, of half the size, with the modes far above as a
    polynomial in lambda.
    """
    largest = max(float(abs(residue).max(initial=0.0)), abs(static) * omega_max**2)
    if not largest:
        return np.empty(0, dtype=np.complex128)
    w2, r = (omega / omega_max) ** 2, residue / largest
    low = omega <= _FAR * omega_max
    k, p = int(low.sum()), np.arange(_TERMS)
    series = (-1.0) ** p * np.sum(r[~low, None] / w2[~low, None] ** (p + 1), axis=0)
    series[0] += static * omega_max**2 / largest
    A, E = np.zeros((2, k + _TERMS, k + _TERMS))
    at = np.arange(k)
    A[at, at], A[:k, k], E[at, at] = -w2[low], 1.0, 1.0
    power = k + np.arange(_TERMS - 1)
    A[power, power + 1], E[power, power] = 1.0, 1.0
    A[-1, :k], A[-1, k:] = r[low], series
    alpha, beta = la.eigvals(A, E, homogeneous_eigvals=True)
    # Where no mode responds, every number is a root, and the pencil returns 0/0.
    near = (abs(alpha) <= _BEYOND**2 * abs(beta)) & (abs(beta) > _UNDETERMINED * la.norm(E))
    root = omega_max * np.sqrt(alpha[near] / beta[near] + 0j)
    root.imag[abs(root.imag) <= _ON_AXIS * abs(root)] = 0.0
    real = abs(root.imag) <= _NEAR_AXIS * abs(root)
    upper = np.where(root.imag < 0, -root, root)
    zeros = np.concatenate([upper[~real], root[real], -root[real]])
    # By magnitude; the magnitudes of mirror images differ by rounding alone.
    zeros = zeros[np.argsort(abs(zeros))]
    size = abs(zeros)
    group = np.cumsum(np.diff(size, prepend=0.0) > _ALIKE * size)
    return np.asarray(zeros[np.lexsort((-zeros.real, group))], dtype=np.complex128)


def visible_modes(omega: Array, residue: Array) -> tuple[Array, Array]:
    """Poles in the response of one pair of channels: modes of one frequency as one, without those that cancel.

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
    # The response of a mode is about c b / w^2 well below its frequency, c b / s^2 well above. Rigid motion is compared
    # at the lowest elastic frequency.
    w2 = np.maximum(first, first[first > 0].min(initial=np.inf)) ** 2 if first.any() else np.ones(first.size)
    others = (abs(total) * np.minimum(1.0, w2[:, None] / w2)).max(axis=1)
    seen = abs(total) > _INVISIBLE * others
    return first[seen], total[seen]


def judged_zeros(
    full: Complex, band: tuple[float, float], poles: Array | None = None, hidden: float = 0.0
) -> NDArray[np.int64]:
    """Positions of the reference zeros in a band that damping does not hide; arguments as for `zero_shifts`."""
    size = abs(full)
    inside = np.flatnonzero((size >= band[0]) & (size <= band[1]) & (size > 0))
    if poles is not None and poles.size and inside.size:
        near = (abs(size[inside, None] - poles[None, :]) / size[inside, None]).min(axis=1)
        inside = inside[near > hidden]
    return np.asarray(inside, dtype=np.int64)


def zero_shifts(
    full: Complex, reduced: Complex, band: tuple[float, float], poles: Array | None = None, hidden: float = 0.0
) -> Array:
    """Relative distances between the zeros of the reference model in a band and those of a reduced one.

    Parameters
    ----------
    full, reduced : (z,), (y,) complex128
        In rad/s.
    band : (float, float)
        Frequencies of interest in rad/s.
    poles : (k,) float64, optional
        Frequencies of the reference model in rad/s.
    hidden : float
        Zeros nearer to a pole than this, relative, are left out: damping as large hides the pair, and a reduced model
        may have neither.

    Returns
    -------
    (m,) float64
        |z_r - z| / |z| of every remaining zero, paired one to one with the least sum; infinite where the reduced system
        has none.
    """
    inside = full[judged_zeros(full, band, poles, hidden)]
    distance = abs(reduced[None, :] - inside[:, None]) / abs(inside)[:, None]
    i, j = closest_pairs(distance)
    shifts = np.full(inside.size, np.inf)
    shifts[i] = distance[i, j]
    return shifts
