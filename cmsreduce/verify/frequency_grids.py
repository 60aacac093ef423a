"""Frequencies at which two models are compared: refined at their resonances, or the same in every configuration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bent_intervals", "decibel_grid", "frequency_grid", "lowest_frequency", "thinned", "with_roots"]

Array = NDArray[np.float64]

# A band that starts at zero is compared over this number of decades: below, only rigid motion remains.
_DECADES = 3.0
# Distances from a resonance, in half-power half-widths zeta w, from well inside the peak to well outside.
_OFFSETS = np.concatenate([[0.0], np.geomspace(0.05, 5000.0, 48)])
_OUTSIDE = 40.0
# Flanks of a sharper peak are refined further, to this share of its frequency, where the grid itself is fine enough.
_FLANK = 0.05
# Width given to the peak of a mode without damping, and the damping ratio up to which it has none but rounding.
_NO_DAMPING = 1e-4
_DAMPED = 1e-10
# Points of the fixed grid of the decibel error.
_DECIBEL_POINTS = 1000
# The points around a resonance serve a peak no further off than its own half-width, and half to twice as wide.
_AS_WIDE = 2.0
# Points nearer than this share of a resonance's half-width add nothing to an integral over it.
_THINNING = 0.02
# Nor do points nearer to each other than this share of their distance to the nearest resonance: a third of the points
# of two models less, and the fourth digit of an error of 1 % stays.
_SMOOTH = 0.1
# The bends of a curve, each as large as its whole second difference, may add up to this share of an integral before
# intervals are refined. They are a fifth of a peak midway between two points, six half-widths from both.
_BENT = 1e-3


def lowest_frequency(band: tuple[float, float]) -> float:
    """Lowest frequency compared, in Hz: the band's own, or three decades below its top if that is zero."""
    return band[0] if band[0] > 0 else float(band[1] / 10**_DECADES)


def frequency_grid(band: tuple[float, float], points: int, omega: Array, zeta: Array, coarse: int = 1) -> Array:
    """Logarithmic grid over the band, refined at every resonance, so that no peak is missed.

    Parameters
    ----------
    band : (float, float)
        In Hz.
    points : int
        Points before refinement.
    omega, zeta : (k,) float64
        Resonances of both models in rad/s, and their damping ratios.
    coarse : int
        One in so many points around each resonance is taken.

    Returns
    -------
    (f,) float64
        Circular frequencies in rad/s, ascending.
    """
    low, high = lowest_frequency(band), band[1]
    grid = [2 * np.pi * np.geomspace(low, high, points)]
    offsets = np.concatenate([_OFFSETS[:1], _OFFSETS[1::coarse]])
    offsets = offsets if (zeta > _DAMPED).all() else offsets[1:]
    distance = _half_widths(omega, zeta)[:, None] * offsets
    near = (offsets <= _OUTSIDE) | (distance <= _FLANK * omega[:, None])
    for sign in (-1.0, 1.0):
        grid.append((omega[:, None] + sign * distance)[near])
    w = np.unique(np.concatenate(grid))
    return w[(w >= 2 * np.pi * low * (1 - 1e-12)) & (w <= 2 * np.pi * high * (1 + 1e-12))]


def _half_widths(omega: Array, zeta: Array) -> Array:
    """Half-power half-widths of resonances in rad/s; a mode without damping has the one that its peak is given."""
    return np.asarray(np.where(zeta > _DAMPED, zeta, _NO_DAMPING) * omega)


def with_roots(omega: Array, zeta: Array, s: NDArray[np.complex128]) -> tuple[Array, Array]:
    """Add the complex modes to undamped resonances whose points do not serve their peaks.

    A damper that holds a hinge, or that close modes share, makes modes of other frequencies and of much less damping
    than its share in each undamped mode.

    Parameters
    ----------
    omega, zeta : (k,) float64
        Undamped resonances in rad/s, and the damping ratios from the diagonal of the damping in these modes.
    s : (r,) complex128
        Roots in rad/s, Im s > 0.

    Returns
    -------
    omega, zeta : (k + added,) float64
    """
    size = np.hypot(s.real, s.imag)
    ratio = np.maximum(-s.real / size, 0.0)
    width, own = _half_widths(size, ratio), _half_widths(omega, zeta)
    near = abs(size[:, None] - omega) <= width[:, None]
    alike = (own <= _AS_WIDE * width[:, None]) & (width[:, None] <= _AS_WIDE * own)
    added = ~(near & alike).any(axis=1)
    return np.concatenate([omega, size[added]]), np.concatenate([zeta, ratio[added]])


def decibel_grid(band: tuple[float, float]) -> Array:
    """Fixed logarithmic grid of 1000 circular frequencies in the band, rad/s."""
    return 2 * np.pi * np.geomspace(lowest_frequency(band), band[1], _DECIBEL_POINTS)


def bent_intervals(omega: Array, curves: Array) -> NDArray[np.int64]:
    """Intervals of a grid that the trapezoidal rule needs more points in.

    Parameters
    ----------
    omega : (f,) float64
        Ascending, three points or more.
    curves : (k, f) float64
        Functions to integrate, not negative.

    Returns
    -------
    (i,) int64
        Number of the point on their left.
    """
    widths, points = np.gradient(omega), np.zeros(omega.size, dtype=bool)
    for curve in curves:
        bends = widths * abs(np.diff(np.concatenate([curve[1:2], curve, curve[-2:-1]]), 2))
        order = np.argsort(bends)
        points[order[np.cumsum(bends[order]) > _BENT * np.trapezoid(curve, omega)]] = True
    return np.flatnonzero(points[:-1] | points[1:])


def thinned(grid: Array, omega: Array, zeta: Array, points: int) -> Array:
    """Drop points that lie closer together than the response changes, as where resonances of both models meet.

    Parameters
    ----------
    grid : (f,) float64
        From `frequency_grid`.
    omega, zeta, points
        As there.
    """
    if not omega.size:
        return grid
    order = np.argsort(omega)
    peaks, least = omega[order], _THINNING * _half_widths(omega, zeta)[order]
    # The first resonance from which the next one is not nearer.
    nearest = np.searchsorted((peaks[1:] + peaks[:-1]) / 2, grid)
    # Between resonances the response is the smoother the farther they are.
    smooth = np.maximum(least[nearest], _SMOOTH * abs(grid - peaks[nearest]))
    # A sharp peak needs its points beside a broad one that is nearer to them, too: the least sum of both terms over all
    # resonances below, and over all above.
    below, above = np.searchsorted(peaks, grid, side="right"), np.searchsorted(peaks, grid)
    lowest = np.minimum.accumulate(np.append(np.inf, least - _SMOOTH * peaks))[below]
    highest = np.minimum.accumulate(np.append(np.inf, (least + _SMOOTH * peaks)[::-1]))[peaks.size - above]
    sharp = np.minimum(lowest + _SMOOTH * grid, highest - _SMOOTH * grid)
    # The grid before refinement stays, also beside an overdamped mode, which is wider than the band.
    between = np.log(grid[-1] / grid[0]) / points / 2 * grid
    spacing = np.minimum(np.minimum(smooth, sharp), between).tolist()
    w, keep = grid.tolist(), [0]
    for k in range(1, grid.size):
        # The end of the band stays: an error that rises towards it would lose its last part.
        if w[k] - w[keep[-1]] >= spacing[k] or k == grid.size - 1:
            keep.append(k)
    return grid[keep]
