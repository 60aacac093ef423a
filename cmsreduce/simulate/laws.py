"""Laws of actuators: effort over time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Law", "Pulse", "Slew"]

Law = Callable[[float], float]
"""Force or torque at a time in seconds; times in an attribute ``ends`` are not stepped over."""


@dataclass(frozen=True)
class Pulse:
    """One smooth pulse, peak * sin^2, zero before and after.

    Parameters
    ----------
    peak : float
        Largest force or torque.
    duration, start : float
        In seconds.
    """

    peak: float
    duration: float
    start: float = 0.0

    @property
    def ends(self) -> tuple[float, float]:
        """Times at which it begins and ends; no step goes over them."""
        return self.start, self.start + self.duration

    def __call__(self, t: float) -> float:
        """Effort at a time."""
        share = (t - self.start) / self.duration
        return self.peak * float(np.sin(np.pi * share)) ** 2 if 0 < share < 1 else 0.0


@dataclass(frozen=True)
class Slew:
    """Rest to rest through an angle: a full sine of effort, sized for the bodies as if they were rigid.

    The bodies vibrate and swing on after it, as they do in flight: nothing is fed back.

    Parameters
    ----------
    angle : float
        In radians, or in the scene's unit of length for a motion along an axis.
    duration, start : float
        In seconds.
    inertia : float
        Effort per acceleration; the simulation sets it, for the rigid bodies in their first configuration.
    """

    angle: float
    duration: float
    start: float = 0.0
    inertia: float = 1.0

    @property
    def ends(self) -> tuple[float, float]:
        """Times at which it begins and ends; no step goes over them."""
        return self.start, self.start + self.duration

    def __call__(self, t: float) -> float:
        """Effort at a time."""
        share = (t - self.start) / self.duration
        peak = 2 * np.pi * self.inertia * self.angle / self.duration**2
        return peak * float(np.sin(2 * np.pi * share)) if 0 < share < 1 else 0.0
