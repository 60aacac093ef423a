"""Pairs of two lists, one to one, whose distances add up to the least.

Zeros of the response between an actuator and a sensor, which feedback drives the poles to.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

__all__ = [
    "closest_pairs",
    "judged_zeros",
    "visible_modes",
    "zero_shifts",
    "zeros_below",
]


def closest_pairs(distance: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair as many as the shorter list has, as closely as can be in all.

    Parameters
    ----------
    distance : (a, b) float64
        Finite, not negative.

    Returns
    -------
    i, j : (min(a, b),) int64
        Members of the first list, ascending, and of the second.

    Notes
    -----
    Of scipy's graphs, which are in use anyway: to load ``scipy.optimize`` for its assignment takes 0.15 s, a tenth of a
    small body's run. Where several pairings are as close, it is not told which is taken.
    """
    if not distance.size:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    # A graph has no edge of length zero; as many edges are taken in any case, so all may be longer by as much.
    longer = distance + (float(distance.max()) or 1.0)
    i, j = min_weight_full_bipartite_matching(sp.csr_array(longer))
    order = np.argsort(i)
    return np.asarray(i[order], dtype=np.int64), np.asarray(j[order], dtype=np.int64)


Array = NDArray[np.float64]

# A mode with less than this share of what the others are at its frequency has its zero as close to its pole, relative:
# they cancel.
_INVISIBLE = 1e-6
# Modes this close are one pole, whose parts add up or cancel.
_ONE_POLE = 1e-9
# Modes above this many times the highest zero asked for enter by a power series in (w_zero / w)^2, cut off where its
# rest is 4^-14 = 4e-9 of their static part.
_FAR, _TERMS = 2.0, 14
# Zeros this far beyond the highest one asked for are given, too.
_BEYOND = 1.2
# A root with less than this share of itself off the real axis is on it.
_ON_AXIS = 1e-7
# Zeros whose magnitudes differ by less than this share may be mirror images, which rounding puts in any order.
_ALIKE = 1e-6


def zeros_below(omega: Array, residue: Array, top: float, *, static: float = 0.0) -> NDArray[np.complex128]:
    """Undamped zeros of sum residue / (s^2 + w^2) + static up to a frequency: all of them, at a fraction of the cost.

    Parameters
    ----------
    omega : (k,) float64
        Frequencies in rad/s, 0 of rigid modes; all different.
    residue : (k,) float64
        c b of each.
    top : float
        Highest frequency of interest in rad/s.
    static : float
        Gain of static modes.

    Returns
    -------
    (z,) complex128
        In rad/s up to a little above ``top``, those of positive imaginary part and those on the real axis, by
        magnitude, the one on the right first of a pair of mirror images. Of a collocated pair they lie on the imaginary
        axis, between the poles.

    Notes
    -----
    Rosenbrock's pencil (Emami-Naeini, Van Dooren 1982) in lambda = s^2, of half the size, with the modes far above as a
    polynomial in lambda.
    """
    w2, r = (omega / top) ** 2, residue / (float(abs(residue).max(initial=0.0)) or 1.0)
    low = omega <= _FAR * top
    k, p = int(low.sum()), np.arange(_TERMS)
    series = (-1.0) ** p * np.sum(r[~low, None] / w2[~low, None] ** (p + 1), axis=0)
    series[0] += static * top**2 / (float(abs(residue).max(initial=0.0)) or 1.0)
    A, E = np.zeros((2, k + _TERMS, k + _TERMS))
    at = np.arange(k)
    A[at, at], A[:k, k], E[at, at] = -w2[low], 1.0, 1.0
    power = k + np.arange(_TERMS - 1)
    A[power, power + 1], E[power, power] = 1.0, 1.0
    A[-1, :k], A[-1, k:] = r[low], series
    alpha, beta = la.eigvals(A, E, homogeneous_eigvals=True)
    near = abs(alpha) <= _BEYOND**2 * abs(beta)
    root = top * np.sqrt(alpha[near] / beta[near] + 0j)
    real = abs(root.imag) <= _ON_AXIS * abs(root)
    upper = np.where(root.imag < 0, -root, root)
    return _in_order(np.concatenate([upper[~real], root.real[real], -root.real[real]]))


def _in_order(zeros: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Zeros by magnitude; of mirror images, whose magnitudes differ by rounding alone, that on the right first."""
    zeros = zeros[np.argsort(abs(zeros))]
    size = abs(zeros)
    group = np.cumsum(np.diff(size, prepend=0.0) > _ALIKE * size)
    return np.asarray(zeros[np.lexsort((-zeros.real, group))], dtype=np.complex128)


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
    # Well below its frequency a mode is c b / w^2 to the others, well above c b / s^2. Rigid motion is looked at where
    # elastic modes begin.
    w2 = np.maximum(first, first[first > 0].min(initial=np.inf)) ** 2 if first.any() else np.ones(first.size)
    others = (abs(total) * np.minimum(1.0, w2[:, None] / w2)).max(axis=1)
    seen = abs(total) > _INVISIBLE * others
    return first[seen], total[seen]


def judged_zeros(
    full: NDArray[np.complex128], band: tuple[float, float], poles: Array | None = None, hidden: float = 0.0
) -> NDArray[np.int64]:
    """Zeros of a full system in a band that damping does not hide: their positions; arguments of `zero_shifts`."""
    size = abs(full)
    inside = np.flatnonzero((size >= band[0]) & (size <= band[1]) & (size > 0))
    if poles is not None and poles.size and inside.size:
        near = (abs(size[inside, None] - poles[None, :]) / size[inside, None]).min(axis=1)
        inside = inside[near > hidden]
    return np.asarray(inside, dtype=np.int64)


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
    inside = full[judged_zeros(full, band, poles, hidden)]
    if not inside.size:
        return np.empty(0)
    distance = abs(reduced[None, :] - inside[:, None]) / abs(inside)[:, None]
    i, j = closest_pairs(distance)
    shifts = np.full(inside.size, np.inf)
    shifts[i] = distance[i, j]
    return shifts
