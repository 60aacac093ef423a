"""What modes carry, for plots: effective mass at an interface, gains between channels, likeness of full and reduced.

Errors of one reduced model in one configuration.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "DampedPairs",
    "ERRORS",
    "EffectiveMassCurve",
    "GainCurve",
    "ModeLikeness",
    "ModelErrors",
]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EffectiveMassCurve:
    """Running effective mass of a body's modes, held at its interfaces.

    Parameters
    ----------
    held : str
        Interfaces that are held.
    hz : (k,) float64
        Frequencies of all modes of the mode set, so held.
    running : (k, 6) float64
        Share of the body's mass along x y z, and of its inertia about them, of the modes up to each one.
    kept_hz, kept_running : (c,), (c, 6) float64
        The same of the modes kept.
    """

    held: str
    hz: Array
    running: Array
    kept_hz: Array
    kept_running: Array


@dataclass(frozen=True, eq=False)
class GainCurve:
    """Running sum of modal gains c b / w^2 of a system in one configuration, pair by pair.

    Parameters
    ----------
    configuration : str
        Setting of the joints.
    hz : (k,) float64
        Frequencies of the reduced system's elastic modes.
    running : (k, outputs, inputs) float64
        Sum of the gains up to each mode.
    total : (outputs, inputs) float64
        Elastic static gain, static modes included.
    whole_hz, whole_running, whole_total : float64 arrays
        The same with every mode of the mode sets, before truncation.
    """

    configuration: str
    hz: Array
    running: Array
    total: Array
    whole_hz: Array
    whole_running: Array
    whole_total: Array


@dataclass(frozen=True, eq=False)
class ModeLikeness:
    """Modal assurance criterion between modes of the full and of a reduced system, in the mass norm.

    Parameters
    ----------
    full_hz, reduced_hz : (f,), (k,) float64
        Natural frequencies up to a little above the band.
    mac : (f, k) float64
        1 for the same shape.
    """

    full_hz: Array
    reduced_hz: Array
    mac: Array


ERRORS = ("frf_error", "db_error", "frequency_error", "damping_error")
"""Errors of a reduced model that a limit can be set on, by their names in `ModelErrors`."""


@dataclass(frozen=True, eq=False)
class DampedPairs:
    """Complex modes of a damped reduced system in the band, each with the full one that it looks like.

    Parameters
    ----------
    full, reduced : (k,) complex128
        Roots -zeta w + i w sqrt(1 - zeta^2) in rad/s.
    mac : (k,) float64
        Modal assurance criterion of the complex shapes in the mass norm.
    error : (k,) float64
        |zeta_reduced - zeta_full| / zeta_full; NaN where the full mode has no damping.
    """

    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    mac: NDArray[np.float64]
    error: NDArray[np.float64]

    @property
    def full_hz(self) -> NDArray[np.float64]:
        """Natural frequencies |s| / 2 pi of the full modes."""
        return np.asarray(abs(self.full) / (2 * np.pi))

    @property
    def reduced_hz(self) -> NDArray[np.float64]:
        """Natural frequencies |s| / 2 pi of the reduced modes."""
        return np.asarray(abs(self.reduced) / (2 * np.pi))

    @property
    def full_zeta(self) -> NDArray[np.float64]:
        """Damping ratios of the full modes."""
        return np.asarray(-self.full.real / abs(self.full))

    @property
    def reduced_zeta(self) -> NDArray[np.float64]:
        """Damping ratios of the reduced modes."""
        return np.asarray(-self.reduced.real / abs(self.reduced))

    @property
    def worst(self) -> float:
        """Largest error; 0 if the band holds no damped mode."""
        return float(np.nanmax(self.error, initial=0.0))


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Errors of one reduced model in one configuration.

    Parameters
    ----------
    frf_error : float
        Relative error of the elastic response over the band.
    db_error : float
        99th percentile of the decibel error, worst channel.
    frequency_error : float
        Largest relative error of a natural frequency in the band, paired by shape.
    frac : (outputs, inputs) float64
        Frequency response assurance criterion per channel, NaN where silent.
    full_hz, reduced_hz, mac : (k,) float64
        Paired natural frequencies and how alike their shapes are.
    damped : DampedPairs, optional
        Paired complex modes; None for a system without damping.
    likeness : ModeLikeness, optional
        Of every full and every reduced mode.
    coordinates : int, optional
        Of the assembled reduced system.
    seconds : float, optional
        Wall time of its responses.
    peak_error : float, optional
        Largest relative error of the height of a channel's highest peak; channels that are silent beside the strongest
        of their unit are passed over.
    frac_error : float, optional
        1 less the smallest criterion of those channels.
    channel_error, channel_peak : (outputs, inputs) float64, optional
        Relative error of the elastic response, and of its highest peak, channel by channel; NaN where silent.
    channel_shift : (outputs, inputs) float64, optional
        Largest relative shift of a natural frequency that makes a peak in the channel; NaN where none does.
    nrfd : float, optional
        The largest of these, of the channels that are not silent.
    """

    frf_error: float
    db_error: float
    frequency_error: float
    frac: NDArray[np.float64]
    full_hz: NDArray[np.float64]
    reduced_hz: NDArray[np.float64]
    mac: NDArray[np.float64]
    damped: DampedPairs | None = None
    likeness: ModeLikeness | None = None
    coordinates: int | None = None
    seconds: float | None = None
    peak_error: float | None = None
    frac_error: float | None = None
    channel_error: NDArray[np.float64] | None = None
    channel_peak: NDArray[np.float64] | None = None
    channel_shift: NDArray[np.float64] | None = None
    nrfd: float | None = None

    @property
    def shift(self) -> NDArray[np.float64]:
        """Relative error of each natural frequency, |reduced - full| / full (k,): the normalised difference NRFD."""
        return np.asarray(abs(self.reduced_hz - self.full_hz) / np.where(self.full_hz > 0, self.full_hz, 1.0))

    @property
    def damping_error(self) -> float | None:
        """Largest relative error of a damping ratio in the band; None for a system without damping."""
        return None if self.damped is None else self.damped.worst
