"""Errors of a reduced system's natural frequencies, paired by shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["FrequencyPairs", "pair_frequencies"]


@dataclass(frozen=True, eq=False)
class FrequencyPairs:
    """Each mode of the reduced system in the band, and the full mode it looks like most.

    Parameters
    ----------
    reduced_hz, full_hz : (k,) float64
        Natural frequencies of the pairs.
    mac : (k,) float64
        Modal assurance criterion in the mass norm, 1 for the same shape.
    error : (k,) float64
        |reduced - full| / full.
    """

    reduced_hz: NDArray[np.float64]
    full_hz: NDArray[np.float64]
    mac: NDArray[np.float64]
    error: NDArray[np.float64]

    @property
    def worst(self) -> float:
        """Largest error; 0 if the band holds no mode."""
        return float(self.error.max(initial=0.0))


def pair_frequencies(
    full: NDArray[np.float64], reduced: NDArray[np.float64], cross: NDArray[np.float64], band_hz: float
) -> FrequencyPairs:
    """Pair frequencies by cross-orthogonality.

    Modes of the full system that the reduced one leaves out on purpose have no pair and count for nothing here: what
    they do in the scene is in the response errors.

    Parameters
    ----------
    full, reduced : (f,), (k,) float64
        Natural frequencies in rad/s.
    cross : (f, k) float64
        phi_full^T M phi_reduced, both orthonormal in M.
    band_hz : float
        Reduced modes above it are left out.

    Returns
    -------
    FrequencyPairs
    """
    inside = reduced <= 2 * np.pi * band_hz
    if not full.size or not inside.any():
        none = np.empty(0)
        return FrequencyPairs(none, none, none, none)
    mac = cross[:, inside] ** 2
    best = mac.argmax(axis=0)
    w, w_r = full[best], reduced[inside]
    return FrequencyPairs(
        w_r / (2 * np.pi), w / (2 * np.pi), mac[best, np.arange(best.size)], abs(w_r - w) / np.maximum(w, 1e-300)
    )
