"""How far mass properties and modal integrals of two models of one body are apart, in units of what the mass allows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.verify.mass_properties import rigid_mass_properties

__all__ = ["integral_change", "mass_change"]

Array = NDArray[np.float64]


def mass_change(old: Array, new: Array) -> dict[str, float]:
    """Changes of mass, centre of mass and inertia between two rigid mass matrices.

    Parameters
    ----------
    old, new : (6, 6) float64
        R^T M R about one origin, in the same units.

    Returns
    -------
    dict
        ``mass`` relative; ``centre of mass`` in radii of gyration of the old body; ``inertia`` about each centre,
        relative to the largest moment. Infinite where the old body has no mass and the new one has.
    """
    was, now = rigid_mass_properties(old), rigid_mass_properties(new)
    m, m2, J, J2 = float(was.mass.max()), float(now.mass.max()), was.inertia, now.inertia
    if m <= 0:
        return dict.fromkeys(("mass", "centre of mass", "inertia"), 0.0 if m2 <= 0 else float("inf"))
    largest = float(abs(J).max())
    radius = np.sqrt(largest / m)
    shift = float(np.linalg.norm(now.cg - was.cg))
    return {
        "mass": abs(m2 - m) / m,
        "centre of mass": shift / radius if radius > 0 else (0.0 if shift == 0 else float("inf")),
        "inertia": float(abs(J2 - J).max()) / largest if largest > 0 else float(abs(J2 - J).max() > 0),
    }


def integral_change(old: Array, new: Array, axes: Sequence[int], turn: Array, bound: float) -> float:
    """Largest change of an integral over modes, after the new modes are turned into the old ones.

    Parameters
    ----------
    old, new : (..., k, ...) float64
        Integral over the paired modes, in the order of the pairs.
    axes : sequence of int
        Axes that count modes.
    turn : (k, k) float64
        Turns new modes into old ones.
    bound : float
        Largest value that the mass allows: sqrt(m) of int phi dm for modes of unit modal mass (Cauchy-Schwarz).

    Returns
    -------
    float
        Relative to the bound.
    """
    for axis in axes:
        new = np.moveaxis(np.tensordot(new, turn, axes=(axis, 0)), -1, axis)
    change = float(abs(new - old).max(initial=0.0))
    return change / bound if bound > 0 else (0.0 if change == 0 else float("inf"))
