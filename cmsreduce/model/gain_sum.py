"""Modal gains between channels, and which modes above the band are a large part of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["GainSum", "HighGain"]

Array = NDArray[np.float64]

# A mode above the band that makes up this share of all gains is no detail: without it every zero moves, the lowest
# most (Haugse, Jones, Salus).
_HIGH = 0.1


@dataclass(frozen=True)
class HighGain:
    """A mode above the band that a pair of channels cannot do without.

    Parameters
    ----------
    mode, output, input : int
        Position among the modes, and of the channels.
    hz : float
        Its frequency.
    gain : float
        c b / w^2.
    share : float
        Its part of the sum of |gains| of this pair.
    """

    mode: int
    output: int
    input: int
    hz: float
    gain: float
    share: float


@dataclass(frozen=True, eq=False)
class GainSum:
    """Gains c b / w^2 of elastic modes between channels: G(s) = G0 / s^2 + sum gain / (s^2 / w^2 + 2 zeta s / w + 1).

    Parameters
    ----------
    hz : (k,) float64
        Frequencies, ascending.
    gain : (k, outputs, inputs) float64
        Of each mode.
    static : (outputs, inputs) float64
        Of what has no frequency: static modes.
    """

    hz: Array
    gain: Array
    static: Array

    @property
    def running(self) -> Array:
        """Sum of the gains up to each mode (k, outputs, inputs), static modes left out."""
        return np.asarray(np.cumsum(self.gain, axis=0))

    @property
    def total(self) -> Array:
        """Elastic static gain (outputs, inputs)."""
        return np.asarray(self.gain.sum(axis=0) + self.static)

    @property
    def size(self) -> Array:
        """Sum of the magnitudes of all gains (outputs, inputs)."""
        return np.asarray(abs(self.gain).sum(axis=0) + abs(self.static))

    def high_gain_modes(self, band_hz: float, share: float = _HIGH) -> Iterator[HighGain]:
        """Modes above the band with a large part of the gain, pair by pair, largest first.

        Parameters
        ----------
        band_hz : float
            Highest frequency of interest.
        share : float
            Part of the sum of magnitudes, static modes included, from which a mode counts as high.
        """
        size = self.size
        part = abs(self.gain) / np.where(size > 0, size, 1.0)
        found = np.argwhere((part >= share) & (self.hz > band_hz)[:, None, None])
        for k, y, u in sorted(found.tolist(), key=lambda at: -part[tuple(at)]):
            yield HighGain(k, y, u, float(self.hz[k]), float(self.gain[k, y, u]), float(part[k, y, u]))
