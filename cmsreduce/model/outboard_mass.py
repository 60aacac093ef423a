"""What hangs on an interface of a body, as one rigid mass: data of an augmented body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["OutboardMass"]


@dataclass(frozen=True, eq=False)
class OutboardMass:
    """Everything outboard of an interface, rigid and as built.

    Parameters
    ----------
    interface : str
        Interface of the inboard body.
    point : (3,) float64
        Its first node in the inboard body's basic frame: what follows is about it, along that body's basic axes.
    rigid_mass : (6, 6) float64
        Mass matrix of three translations and three rotations, inertias of joints included.
    bodies : tuple of str
        What it is the mass of.
    """

    interface: str
    point: NDArray[np.float64]
    rigid_mass: NDArray[np.float64]
    bodies: tuple[str, ...]

    @property
    def mass(self) -> float:
        """Mass."""
        return float(self.rigid_mass[0, 0])

    @property
    def first_moment(self) -> NDArray[np.float64]:
        """Int r dm (3,), r from the point."""
        M = self.rigid_mass
        return np.array([M[1, 5] - M[2, 4], M[2, 3] - M[0, 5], M[0, 4] - M[1, 3]]) / 2

    @property
    def inertia(self) -> NDArray[np.float64]:
        """Int (r.r 1 - r r^T) dm (3, 3) about the point."""
        return self.rigid_mass[3:, 3:]
