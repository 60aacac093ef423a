"""The worst of one figure of a run, with its limit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["OF_A_CONTROLLER", "RunFigure"]

OF_A_CONTROLLER = {"controller_ratio": float(np.nextafter(1.0, 0.0)), "controller_unstable": 0.0}
"""Limits of every controller that a scene names: a ratio of one proves nothing, and a reduced loop that is not stable
has nothing to keep."""


@dataclass(frozen=True)
class RunFigure:
    """An error or a check of the run's own model at its worst.

    Parameters
    ----------
    value : float
        Largest.
    where : str
        Where it was found.
    limit : float, optional
        Largest value that passes.
    """

    value: float
    where: str
    limit: float | None

    @property
    def met(self) -> bool | None:
        """Whether the limit is met; None without one."""
        return None if self.limit is None else bool(self.value <= self.limit)
