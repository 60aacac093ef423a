"""What modes carry, for plots: effective mass at an interface, gains between channels, likeness of full and reduced."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["EffectiveMassCurve", "GainCurve", "ModeLikeness"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EffectiveMassCurve:
    """Running effective mass of a body's modes, held at its interfaces.

    Parameters
    ----------
    held : str
        Interfaces that are held.
    hz : (k,) float64
        Frequencies of all modes of the mode set, so held.
    running : (k, 6) float64
        Share of the body's mass along x y z, and of its inertia about them, of the modes up to each one.
    kept_hz, kept_running : (c,), (c, 6) float64
        The same of the modes kept.
    """

    held: str
    hz: Array
    running: Array
    kept_hz: Array
    kept_running: Array


@dataclass(frozen=True, eq=False)
class GainCurve:
    """Running sum of modal gains c b / w^2 of a system in one configuration, pair by pair.

    Parameters
    ----------
    configuration : str
        Setting of the joints.
    hz : (k,) float64
        Frequencies of the reduced system's elastic modes.
    running : (k, outputs, inputs) float64
        Sum of the gains up to each mode.
    total : (outputs, inputs) float64
        Elastic static gain, static modes included.
    whole_hz, whole_running, whole_total : float64 arrays
        The same with every mode of the mode sets, before truncation.
    """

    configuration: str
    hz: Array
    running: Array
    total: Array
    whole_hz: Array
    whole_running: Array
    whole_total: Array


@dataclass(frozen=True, eq=False)
class ModeLikeness:
    """Modal assurance criterion between modes of the full and of a reduced system, in the mass norm.

    Parameters
    ----------
    full_hz, reduced_hz : (f,), (k,) float64
        Natural frequencies up to a little above the band.
    mac : (f, k) float64
        1 for the same shape.
    """

    full_hz: Array
    reduced_hz: Array
    mac: Array
