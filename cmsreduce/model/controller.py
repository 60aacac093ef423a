"""A controller in state space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Controller"]


@dataclass(frozen=True, eq=False)
class Controller:
    """x' = A x + B y, v = C x + D y: from the sensors' signals y to efforts v, which act as u = -v.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, sensors), (actuators, n), (actuators, sensors) float64
        In the order of the scene's sensors, motion by motion, and of its actuators; n may be 0.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]

    @property
    def states(self) -> int:
        """Number of states n."""
        return int(self.A.shape[0])
