"""Effective modal mass: how much of a body's mass each mode moves along and about each axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["EffectiveMass", "effective_mass"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EffectiveMass:
    """Effective masses of modes held at an interface.

    Parameters
    ----------
    hz : (k,) float64
        Frequencies.
    mass : (k, 6) float64
        Effective mass along x, y, z and moment of inertia about them, through the point that the rigid motions turn
        about.
    total : (6,) float64
        Of the whole body. All modes together fall short of it by what the held nodes themselves carry.
    """

    hz: Array
    mass: Array
    total: Array

    @property
    def share(self) -> Array:
        """Effective mass of each mode as a share of the whole body's (k, 6); 0 where that has none."""
        return np.asarray(self.mass / np.where(self.total > 0, self.total, 1.0))

    @property
    def running(self) -> Array:
        """Share of the modes up to each one (k, 6)."""
        return np.asarray(np.cumsum(self.share, axis=0))


def effective_mass(hz: Array, momentum: Array, rigid_mass: Array) -> EffectiveMass:
    """Effective masses from the momentum of modes of unit modal mass.

    Parameters
    ----------
    hz : (k,) float64
        Frequencies.
    momentum : (6, k) float64
        R^T M Phi, Phi zero at the held dofs.
    rigid_mass : (6, 6) float64
        R^T M R about the same point.

    Notes
    -----
    Source: Wada, Bamford, Garba (1972). The square of a mode's participation in the rigid motion of its support.
    """
    return EffectiveMass(hz, (momentum**2).T, rigid_mass.diagonal().copy())
