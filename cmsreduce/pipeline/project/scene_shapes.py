"""Shapes of large bodies from responses of the scene, and how their number was found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SceneShapes"]

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SceneShapes:
    """Elastic shapes of large bodies, and how their number was found.

    Parameters
    ----------
    shapes : mapping of body to (n, k) float64
        Orthonormal in the stiffness.
    hz : tuple of float
        Frequencies of the points, in order.
    estimate, aim : float
        Estimated frf_error of the worst configuration, and what it was to come below.
    where : str
        Its name.
    checked : tuple of (float, float, float)
        Frequency in Hz, error found by a solve of the bodies there before its responses were added, and its estimate
        before; both relative to the response of the worst configuration at this frequency.
    """

    shapes: Mapping[str, Real]
    hz: tuple[float, ...]
    estimate: float
    aim: float
    where: str
    checked: tuple[tuple[float, float, float], ...]

    @property
    def _aim(self) -> str:
        met = self.estimate <= self.aim
        return f"{'below' if met else 'not below'} the {self.aim:.2g} aimed at"

    def note(self, name: str) -> str:
        """The basis of one body in words."""
        off = max((error / estimate for _, error, estimate in self.checked if estimate), default=0.0)
        return (
            f"{name}: {self.shapes[name].shape[1]} static shapes and responses of the scene at {len(self.hz)} "
            f"frequencies; frf_error is estimated at {self.estimate:.2g} in '{self.where}', {self._aim}, and at "
            f"{len(self.checked)} of them solves of the bodies found at most {off:.3g} times the estimated error. "
            "They serve this scene; for other loads, sensors or bands use craig-bampton"
        )
