"""Mass properties of a body by rigid motions of any origin, and whether any distribution of mass has them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.verify.mass_properties import MassProperties, rigid_mass_properties

__all__ = ["REALISABLE", "PrincipalInertia", "inertia_excess", "principal_inertia"]

Array = NDArray[np.float64]

REALISABLE = 1e-6
"""Printed digits of a mass matrix may put a thin body's inertia this far beyond what mass can have, relative."""

# The mass of a free body is the same in all directions, to the few digits that a condensed body keeps.
_SAME_MASS = 1e-3


@dataclass(frozen=True, eq=False)
class PrincipalInertia:
    """Inertia about the centre of mass, as figures that a drawing or another model can be held against.

    Parameters
    ----------
    gyration : (3,) float64
        Radii of gyration about x, y, z through the centre of mass.
    moments : (3,) float64
        Principal moments in ascending order.
    radii : (3,) float64
        Radii of gyration about the principal axes.
    axes : (3, 3) float64
        Principal axes as rows, in the basic frame, right handed.
    """

    gyration: Array
    moments: Array
    radii: Array
    axes: Array


def principal_inertia(found: MassProperties) -> PrincipalInertia:
    """Radii of gyration and principal axes.

    Parameters
    ----------
    found : MassProperties
        Of a body with mass.

    Notes
    -----
    A moment that rounding leaves below zero has a radius of 0.
    """
    mass = float(found.mass.max())
    moments, V = np.linalg.eigh((found.inertia + found.inertia.T) / 2)
    axes = V.T * np.sign(np.linalg.det(V))
    return PrincipalInertia(_radii(found.inertia.diagonal(), mass), moments, _radii(moments, mass), axes)


def inertia_excess(rigid_mass: Array) -> float | None:
    """How far an inertia is beyond what a distribution of mass can have.

    Parameters
    ----------
    rigid_mass : (6, 6) float64
        R^T M R.

    Returns
    -------
    float or None
        Largest violation of: principal moments that are not negative, none larger than the sum of the other two;
        relative to the largest moment. 0 for every real body. None of a body that does not move freely in all
        directions, whose inertia is not that of its mass.
    """
    found = rigid_mass_properties(rigid_mass)
    if found.mass.min() < (1 - _SAME_MASS) * found.mass.max() or found.mass.max() <= 0:
        return None
    a, b, c = np.linalg.eigvalsh((found.inertia + found.inertia.T) / 2)
    largest = max(abs(a), abs(c))
    return max(0.0, -a, c - a - b) / largest if largest > 0 else 0.0


def _radii(moments: Array, mass: float) -> Array:
    return np.sqrt(np.maximum(moments, 0.0) / mass) if mass > 0 else np.zeros(moments.size)
