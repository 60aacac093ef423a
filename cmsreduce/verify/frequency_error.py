"""Errors of a reduced system's natural frequencies, paired by shape.

Errors of a reduced system's damping ratios, complex modes paired by shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DampedPairs

__all__ = [
    "FrequencyPairs",
    "pair_complex_modes",
    "pair_frequencies",
]


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


# A mode whose damping ratio is below this is damped by round-off, or next to not at all: its ratio has no error.
_UNDAMPED = 1e-9
# Shapes this near to the likest one look as much alike: where modes are repeated or damping mixes close ones, a shape
# may be any mixture, and the nearest root among them is the partner.
_AS_ALIKE = 0.5


def pair_complex_modes(
    full: NDArray[np.complex128], reduced: NDArray[np.complex128], cross: NDArray[np.complex128], band_hz: float
) -> DampedPairs:
    """Pair each oscillating mode of the reduced system in the band with the full one that it looks like.

    Parameters
    ----------
    full, reduced : (f,), (k,) complex128
        Roots s in rad/s, Im s > 0.
    cross : (f, k) complex128
        x_full^H M x_reduced, both of unit length in M.
    band_hz : float
        Reduced modes with |s| above it are left out.
    """
    inside = abs(reduced) <= 2 * np.pi * band_hz
    if not full.size or not inside.any():
        none = np.empty(0)
        return DampedPairs(none.astype(np.complex128), none.astype(np.complex128), none, none)
    there, mac = reduced[inside], abs(cross[:, inside]) ** 2
    alike = mac >= _AS_ALIKE * mac.max(axis=0)
    best = np.where(alike, abs(full[:, None] - there), np.inf).argmin(axis=0)
    here = full[best]
    zeta, zeta_r = -here.real / abs(here), -there.real / abs(there)
    damped = zeta > _UNDAMPED
    error = np.where(damped, abs(zeta_r - zeta) / np.where(damped, zeta, 1.0), np.nan)
    return DampedPairs(here, there, mac[best, np.arange(best.size)], error)
