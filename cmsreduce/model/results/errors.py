"""Findings with their limits, and errors of one reduced model in one configuration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["ERRORS", "BetweenErrors", "DampedPairs", "Finding", "MacMatrix", "ModelErrors", "UnpairedMode"]

Array = NDArray[np.float64]

ERRORS = ("frf_error", "channel_error", "db_error", "frequency_error", "damping_error")
"""Errors of a reduced model that can have a limit, by their names in `ModelErrors`."""


@dataclass(frozen=True)
class Finding:
    """A measured quantity with its limit and verdict.

    Parameters
    ----------
    name : str
        Quantity.
    value : float
        Measured value.
    limit : float
        Largest value that passes; a value without a limit is only shown.
    note : str
        Place of the largest value, or the change, in words.
    subject : str
        Component; empty for the whole run.
    """

    name: str
    value: float
    limit: float = math.inf
    note: str = ""
    subject: str = ""

    @property
    def label(self) -> str:
        """Component and quantity: ``rotor: orthogonality in M``."""
        return f"{self.subject}: {self.name}" if self.subject else self.name

    @property
    def limit_name(self) -> str:
        """Name of its limit: one limit judges the response error in and between the sampled configurations."""
        return self.name.partition(" ")[0]

    @property
    def judged(self) -> bool:
        """True if there is a limit."""
        return not math.isinf(self.limit)

    @property
    def passed(self) -> bool:
        """True if the value meets the limit or there is none; NaN meets no limit."""
        return bool(self.value <= self.limit) or not self.judged

    @property
    def ratio(self) -> float:
        """Value over its limit: at most 1 if it passes, infinite if it was not measured or none is allowed.

        Examples
        --------
        >>> Finding("frf_error", 0.025, 0.05).ratio, Finding("modes_lost", 0.0, 0.0).ratio
        (0.5, 0.0)
        """
        if math.isnan(self.value):
            return math.inf
        if self.limit > 0:
            return self.value / self.limit
        return 0.0 if self.passed else math.inf

    @property
    def verdict(self) -> str:
        """``pass``, ``FAIL`` or, without a limit, ``info``."""
        if not self.judged:
            return "info"
        return "pass" if self.passed else "FAIL"


@dataclass(frozen=True, eq=False)
class MacMatrix:
    """Modal assurance criterion (MAC) between the modes of the reference and of a reduced model, in the mass norm.

    Parameters
    ----------
    full_hz, reduced_hz : (f,), (k,) float64
        Natural frequencies of the reference and of the reduced model, up to a little above the band.
    mac : (f, k) float64
        1 for equal shapes, 0 for orthogonal ones.
    """

    full_hz: Array
    reduced_hz: Array
    mac: Array


@dataclass(frozen=True, eq=False)
class DampedPairs:
    """Complex modes of a damped reduced model in the band, each paired with the mode of the reference by its shape.

    Parameters
    ----------
    full, reduced : (k,) complex128
        Roots -zeta w + i w sqrt(1 - zeta^2) in rad/s.
    mac : (k,) float64
        MAC of the complex shapes in the mass norm.
    error : (k,) float64
        |zeta_reduced - zeta_full| / zeta_full; NaN where the reference mode has no damping.
    alone : int
        Oscillating modes of either model in the band, if there is no pair.
    lost : tuple of UnpairedMode
        Oscillating modes of the reference in the band that the reduced model lacks.
    farthest : UnpairedMode, optional
        Reference mode of the largest error, if that is large.
    """

    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    mac: NDArray[np.float64]
    error: NDArray[np.float64]
    alone: int = 0
    lost: tuple[UnpairedMode, ...] = ()
    farthest: UnpairedMode | None = None

    @property
    def full_hz(self) -> NDArray[np.float64]:
        """Natural frequencies |s| / 2 pi of the reference modes."""
        return np.asarray(abs(self.full) / (2 * np.pi))

    @property
    def reduced_hz(self) -> NDArray[np.float64]:
        """Natural frequencies |s| / 2 pi of the reduced modes."""
        return np.asarray(abs(self.reduced) / (2 * np.pi))

    @property
    def full_zeta(self) -> NDArray[np.float64]:
        """Damping ratios of the reference modes."""
        return np.asarray(-self.full.real / abs(self.full))

    @property
    def reduced_zeta(self) -> NDArray[np.float64]:
        """Damping ratios of the reduced modes."""
        return np.asarray(-self.reduced.real / abs(self.reduced))

    @property
    def worst(self) -> float:
        """Largest error; 0 if no mode in the band is damped, NaN if the band holds modes and no pair."""
        if self.alone and not self.error.size:
            return float("nan")
        return float(np.nanmax(self.error, initial=0.0))


@dataclass(frozen=True)
class UnpairedMode:
    """Mode in the band that the other model does not have, or has with a far error; the channel that shows it best.

    Parameters
    ----------
    hz : float
        Natural frequency.
    body : str
        Body with most of its kinetic energy.
    share : float
        Share of the kinetic energy in this body.
    seen : float
        Largest peak of the mode in any judged channel, as a share of the highest peak of this channel.
    channel : (int, int), optional
        Output and input of this channel; None if no channel is judged.
    """

    hz: float
    body: str
    share: float
    seen: float
    channel: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class ModelErrors:
    """Errors of one reduced model in one configuration.

    Parameters
    ----------
    frf_error : float
        Relative error of the elastic response over the band, against the reference model.
    db_error : float
        99th percentile of the decibel error, worst channel.
    frequency_error : float
        Largest relative error of a natural frequency in the band, paired one to one; NaN if the band holds modes and no
        pair.
    frac : (outputs, inputs) float64
        Frequency response assurance criterion per channel, NaN where silent.
    full_hz, reduced_hz, mac : (k,) float64
        Paired natural frequencies of the reference and of the reduced model, and the MAC of their shapes.
    damped : DampedPairs, optional
        Paired complex modes; None for a system without damping.
    mac_matrix : MacMatrix, optional
        MAC between all reference modes and all reduced modes.
    coordinates : int, optional
        Number of coordinates of the assembled reduced model.
    seconds : float, optional
        Wall time of its responses.
    peak_error : float, optional
        Largest relative error of the height of a channel's highest peak, without the channels that are silent beside
        the strongest one of their unit.
    frac_error : float, optional
        1 less the smallest criterion of the same channels.
    channel_errors, channel_peak : (outputs, inputs) float64, optional
        Relative error of the elastic response, and of its highest peak, channel by channel; NaN where silent. Where
        only the reference model is silent, the error is a share of the motion that the channel could have.
    channel_db : (outputs, inputs) float64, optional
        Decibel error, channel by channel; NaN where silent.
    channel_shift : (outputs, inputs) float64, optional
        Largest relative shift of a natural frequency with a peak in the channel; NaN where there is no peak.
    nrfd : float, optional
        Largest ``channel_shift`` of the channels that are not silent.
    responding : (outputs, inputs) bool, optional
        Channels whose elastic response is more than rounding, in either model.
    loud : (outputs, inputs) bool, optional
        Channels that are judged: they respond, and are not silent beside the strongest one.
    lost, extra : tuple of UnpairedMode
        Modes in the band that only the reference model has, and those that only the reduced model has.
    farthest : UnpairedMode, optional
        Reference mode of ``frequency_error``, if that is large.
    """

    frf_error: float
    db_error: float
    frequency_error: float
    frac: NDArray[np.float64]
    full_hz: NDArray[np.float64]
    reduced_hz: NDArray[np.float64]
    mac: NDArray[np.float64]
    damped: DampedPairs | None = None
    mac_matrix: MacMatrix | None = None
    coordinates: int | None = None
    seconds: float | None = None
    peak_error: float | None = None
    frac_error: float | None = None
    channel_errors: NDArray[np.float64] | None = None
    channel_peak: NDArray[np.float64] | None = None
    channel_db: NDArray[np.float64] | None = None
    channel_shift: NDArray[np.float64] | None = None
    nrfd: float | None = None
    responding: NDArray[np.bool_] | None = None
    loud: NDArray[np.bool_] | None = None
    lost: tuple[UnpairedMode, ...] = ()
    extra: tuple[UnpairedMode, ...] = ()
    farthest: UnpairedMode | None = None

    @property
    def worst_channel(self) -> tuple[int, int] | None:
        """Output and input of the judged channel with the largest error; None without such a channel."""
        if self.channel_errors is None:
            return None
        judged = np.where(np.isnan(self.channel_errors), -1.0, self.channel_errors)
        judged = judged if self.loud is None else np.where(self.loud, judged, -1.0)
        if judged.max(initial=-1.0) < 0:
            return None
        y, u = np.unravel_index(int(judged.argmax()), judged.shape)
        return int(y), int(u)

    @property
    def worst_db_channel(self) -> tuple[int, int] | None:
        """Output and input of the channel with the largest decibel error; None without one."""
        if self.channel_db is None or not np.nanmax(self.channel_db, initial=0.0) > 0:
            return None
        y, u = np.unravel_index(int(np.nanargmax(self.channel_db)), self.channel_db.shape)
        return int(y), int(u)

    @property
    def channel_error(self) -> float | None:
        """Relative error of the elastic response of the worst channel; None if it was not measured."""
        at = self.worst_channel
        if self.channel_errors is None:
            return None
        return float("nan") if at is None else float(self.channel_errors[at])

    @property
    def modes_lost(self) -> float:
        """Number of modes in the band that the reduced model lacks."""
        return float(len(self.lost))

    @property
    def modes_extra(self) -> float:
        """Number of modes in the band that only the reduced model has."""
        return float(len(self.extra))

    @property
    def shift(self) -> NDArray[np.float64]:
        """Relative error of each natural frequency, |reduced - full| / full (k,): the normalised difference NRFD."""
        return np.asarray(abs(self.reduced_hz - self.full_hz) / np.where(self.full_hz > 0, self.full_hz, 1.0))

    @property
    def damping_error(self) -> float | None:
        """Largest relative error of a damping ratio in the band; None for a system without damping."""
        return None if self.damped is None else self.damped.worst


@dataclass(frozen=True)
class BetweenErrors:
    """Response errors at midpoint configurations.

    Parameters
    ----------
    errors : mapping of str to float
        frf_error by the name of the configuration.
    midpoints : int
        Number of all midpoint configurations of the scene.
    left_out : tuple of str
        Configurations that cannot be reached, with the reason.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    midpoints: int = 0
    left_out: tuple[str, ...] = ()

    @property
    def unmeasured(self) -> int:
        """Midpoint configurations that can be reached, or were not tried, and have no error."""
        return self.midpoints - len(self.errors) - len(self.left_out)
