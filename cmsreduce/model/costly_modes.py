"""Modes that set an integrator's step and do not serve the band."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["CostlyMode", "CostlyModes"]


@dataclass(frozen=True)
class CostlyMode:
    """One of them.

    Parameters
    ----------
    mode : int
        Column of the body's shapes, from 0.
    hz : float
        Its frequency.
    kind : str
        Kind of basis shape with most of its kinetic energy.
    share : float
        What its mass changes of the flexibility in the band, of the static flexibility of the point and direction where
        that is most.
    """

    mode: int
    hz: float
    kind: str
    share: float


@dataclass(frozen=True)
class CostlyModes:
    """The modes of a body above all that serve the band.

    Parameters
    ----------
    modes : tuple of CostlyMode
        By frequency.
    serving_hz : float
        Highest frequency of the others; the upper end of the band if there are none.
    factor, share : float
        A mode serves the band if its frequency is below ``factor`` times the upper end of the band, or its share above
        ``share``.
    """

    modes: tuple[CostlyMode, ...]
    serving_hz: float
    factor: float
    share: float

    @property
    def gain(self) -> float:
        """How many times longer the step may be where they are treated statically."""
        return self.modes[-1].hz / self.serving_hz if self.modes else 1.0
