"""Scene shapes after an optimisation, with their errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Judged", "Settled"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors of one set of shapes, each over its limit.

    Parameters
    ----------
    frf, db : (configurations,) float64
        Of the response, and in decibels; zero for an error without a limit.
    worst : float
        The largest of all errors that have a limit.
    """

    frf: Array
    db: Array
    worst: float


@dataclass(frozen=True, eq=False)
class Settled:
    """Shapes after rounds of optimisation, the best that were found.

    Parameters
    ----------
    shapes : mapping of body to (n, k) float64
    judged : Judged
    steps : int
        Steps of the optimisation.
    """

    shapes: dict[str, Array]
    judged: Judged
    steps: int

    @property
    def passes(self) -> bool:
        """All limits are met."""
        return self.judged.worst <= 1

    @property
    def counts(self) -> dict[str, int]:
        """Number of shapes of each body."""
        return {name: V.shape[1] for name, V in self.shapes.items()}

    @property
    def count(self) -> int:
        """Number of shapes of all bodies."""
        return sum(self.counts.values())
