"""What is proven of the normal modes a body was reduced to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["ModeCertificate"]


@dataclass(frozen=True, eq=False)
class ModeCertificate:
    """Proof that no normal mode below a cutoff is missing, and how exact the frequencies are.

    Parameters
    ----------
    cutoff_hz : float
        Frequency up to which modes were sought.
    counted : int or None
        Elastic modes below it by a Sturm count, which knows nothing of the modes themselves; None for a body of few
        dofs, all of whose modes were computed.
    frequency_hz : (k,) float64
        Frequencies found, of free or of fixed-interface modes.
    bound : (k,) float64
        Relative error of each frequency at most, from the residual of its mode.
    """

    cutoff_hz: float
    counted: int | None
    frequency_hz: NDArray[np.float64]
    bound: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.frequency_hz.shape != self.bound.shape:
            raise MatrixError(f"{self.frequency_hz.size} frequencies need as many bounds, not {self.bound.size}")

    @property
    def worst_bound(self) -> float:
        """Largest of the bounds; zero where there is no mode."""
        return float(self.bound.max(initial=0.0))
