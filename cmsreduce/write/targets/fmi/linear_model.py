"""A linear model with named channels, whose states are modal amplitudes and their rates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Units

__all__ = ["LinearModel", "Port"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Port:
    """An input or an output.

    Parameters
    ----------
    name : str
        Its name.
    quantity : str
        ``force``, ``torque``, ``translation`` or ``rotation``, with `` rate`` for a rate; anything else has no unit.
    """

    name: str
    quantity: str = ""


@dataclass(frozen=True, eq=False)
class LinearModel:
    """x' = A x + B u, y = C x + D u with x = [q; v], amplitudes of m modes and their rates: q' = v.

    Parameters
    ----------
    name, about : str
        Name, and a sentence on what it is.
    A, B, C, D : (2m, 2m), (2m, u), (y, 2m), (y, u) float64
        In the units of the model, of which that of time may differ from the second.
    inputs, outputs : tuple of Port
        Channels.
    frequency_hz : (m,) float64
        Undamped frequencies in Hz, whatever the unit of time; the zero ones first.
    units : Units, optional
        Unit system of the channels.
    """

    name: str
    about: str
    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    frequency_hz: Array
    units: Units | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return int(self.A.shape[0])

    @property
    def nominal(self) -> Array:
        """Size of the states for unit inputs (2m,): integrators measure their absolute errors against it."""
        m = self.n // 2
        turns = 2 * np.pi * self.frequency_hz * (self.units.time if self.units else 1.0)
        slowest = turns[turns > 0].min(initial=np.inf)
        omega = np.where(turns > 0, turns, slowest if np.isfinite(slowest) else 1.0)
        force = abs(self.B[m:]).max(axis=1, initial=0.0)
        force = np.where(force > 0, force, force.max(initial=0.0) or 1.0)
        return np.concatenate([force / omega**2, force / omega])
