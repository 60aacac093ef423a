"""Frequencies at which two models are compared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["decibel_grid", "frequency_grid", "lowest_frequency"]

# A band that starts at zero is looked at over this many decades: below, only rigid motion is left.
_DECADES = 3.0
# Distances from a resonance, in half-power half-widths zeta w, from well inside the peak to well outside.
_OFFSETS = np.concatenate([[0.0], np.geomspace(0.05, 5000.0, 48)])
_OUTSIDE = 40.0
# Flanks of a sharper peak are followed further, to this share of its frequency, where the grid itself takes over.
_FLANK = 0.05
# Width given to the peak of a mode without damping.
_NO_DAMPING = 1e-4
# Points of the fixed grid of the decibel error.
_DECIBEL_POINTS = 1000


def lowest_frequency(band: tuple[float, float]) -> float:
    """Lowest frequency compared, in Hz: the band's own, or three decades below its top if that is zero."""
    return band[0] if band[0] > 0 else float(band[1] / 10**_DECADES)


def frequency_grid(
    band: tuple[float, float], points: int, omega: NDArray[np.float64], zeta: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Logarithmic grid over the band, refined at every resonance, so that no peak is missed.

    Parameters
    ----------
    band : (float, float)
        In Hz.
    points : int
        Points before refinement.
    omega, zeta : (k,) float64
        Resonances of both models in rad/s, and their damping ratios.

    Returns
    -------
    (f,) float64
        Circular frequencies in rad/s, ascending.
    """
    low, high = lowest_frequency(band), band[1]
    grid = [2 * np.pi * np.geomspace(low, high, points)]
    width = np.where(zeta > 0, zeta, _NO_DAMPING) * omega
    offsets = _OFFSETS if np.all(zeta > 0) else _OFFSETS[1:]
    distance = width[:, None] * offsets
    near = (offsets <= _OUTSIDE) | (distance <= _FLANK * omega[:, None])
    for sign in (-1.0, 1.0):
        grid.append((omega[:, None] + sign * distance)[near])
    w = np.unique(np.concatenate(grid))
    return w[(w >= 2 * np.pi * low * (1 - 1e-12)) & (w <= 2 * np.pi * high * (1 + 1e-12))]


def decibel_grid(band: tuple[float, float]) -> NDArray[np.float64]:
    """Fixed logarithmic grid of 1000 circular frequencies in the band, rad/s."""
    return 2 * np.pi * np.geomspace(lowest_frequency(band), band[1], _DECIBEL_POINTS)
