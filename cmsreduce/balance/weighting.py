"""Frequency weighting of rankings: filters at the inputs of a scene."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.linalg.gramian import Band
from cmsreduce.model import ModalChannels

__all__ = ["BandPass", "LowPass", "TransferFunction", "Weighting"]

Array = NDArray[np.float64]


class Weighting(ABC):
    """A filter at every input; frequencies in rad/s.

    A lightly damped mode responds near its own frequency, so that the filter's gain there, |W(j w_i)|, weighs the mode.
    If the filter is a band, rankings by Gramians limit the Gramians to the band instead. Component cost then
    includes the response of a mode above the band as a spring; Hankel values, which measure memory, hardly include it.
    """

    @abstractmethod
    def magnitude(self, omega: ArrayLike) -> Array:
        """Gain |W(j w)| at each frequency (e,)."""

    @property
    def band(self) -> Band | None:
        """Limits for Gramians; None for a filter without a band."""
        return None

    def applied(self, channels: ModalChannels) -> ModalChannels:
        """Multiply the inputs of each mode by the gain at its frequency."""
        return replace(channels, B=self.magnitude(channels.omega)[:, None] * channels.B)


@dataclass(frozen=True)
class BandPass(Weighting):
    """A band with Butterworth's roll-off on both sides: gain 1 within, 0.71 at the ends.

    Parameters
    ----------
    low, high : float
        Ends in rad/s; ``low`` may be zero.
    order : int
        Each side falls by this many powers of the frequency.

    Raises
    ------
    ConfigError
        If the band is empty or the order is below 1.
    """

    low: float
    high: float
    order: int = 2

    def __post_init__(self) -> None:
        if not 0 <= self.low < self.high or self.order < 1:
            raise ConfigError(
                f"weighting: a band from {self.low:g} to {self.high:g} rad/s of order {self.order} lets nothing "
                "through; give 0 <= low < high and an order of 1 or more"
            )

    def magnitude(self, omega: ArrayLike) -> Array:
        """See `Weighting.magnitude`."""
        w = np.asarray(omega, dtype=np.float64)
        return np.asarray(
            1 / np.sqrt((1 + (w / self.high) ** (2 * self.order)) * (1 + (self.low / w) ** (2 * self.order)))
        )

    @property
    def band(self) -> Band:
        """Both ends."""
        return self.low, self.high


@dataclass(frozen=True)
class LowPass(Weighting):
    """Bandwidth of a sensor or a control loop: first order, or second at 0.71 of critical damping.

    Parameters
    ----------
    bandwidth : float
        Frequency in rad/s at which the gain is 0.71.
    order : int
        1 or 2.

    Raises
    ------
    ConfigError
        If the bandwidth is not positive or the order is not 1 or 2.
    """

    bandwidth: float
    order: int = 1

    def __post_init__(self) -> None:
        if not self.bandwidth > 0 or self.order not in (1, 2):
            raise ConfigError(
                f"weighting: a low-pass of {self.bandwidth:g} rad/s and order {self.order} is not possible; give a "
                "bandwidth above zero and order 1 or 2"
            )

    def magnitude(self, omega: ArrayLike) -> Array:
        """See `Weighting.magnitude`."""
        w = np.asarray(omega, dtype=np.float64)
        return np.asarray(1 / np.sqrt(1 + (w / self.bandwidth) ** (2 * self.order)))


@dataclass(frozen=True)
class TransferFunction(Weighting):
    """Transfer function numerator(s) / denominator(s) of the user, s in rad/s.

    Parameters
    ----------
    numerator, denominator : tuple of float
        Coefficients, highest power first.

    Raises
    ------
    ConfigError
        If one of them is empty or zero.
    """

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            if not np.any(getattr(self, name)):
                raise ConfigError(f"weighting: the {name} is zero; give its coefficients, highest power first")

    def magnitude(self, omega: ArrayLike) -> Array:
        """Gain at each frequency.

        Raises
        ------
        ConfigError
            If the denominator vanishes at one of them.
        """
        s = 1j * np.asarray(omega, dtype=np.float64)
        below = abs(np.polyval(self.denominator, s))
        if np.any(below == 0):
            at = float(np.ravel(abs(s))[int(np.argmin(below))])
            raise ConfigError(
                f"weighting: the transfer function has a pole at {at:g} rad/s, the frequency of a mode, which would "
                "outweigh all others; give it damping"
            )
        return np.asarray(abs(np.polyval(self.numerator, s)) / below)
