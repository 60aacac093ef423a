"""Which modes of a body cost an integrator its step without serving the band."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import CostlyMode, CostlyModes, ModalComponent

__all__ = ["costly_modes"]

# Below twice the band, a mode's mass changes its flexibility in the band by a third or more.
_FACTOR = 2.0
# A thousandth of a point's flexibility is a thousandth of a decade's response there, and 5e-4 of a frequency.
_SHARE = 1e-3


def costly_modes(component: ModalComponent, points: NDArray[np.float64], band_hz: float) -> CostlyModes:
    """Find the modes above all that serve the band.

    Parameters
    ----------
    component : ModalComponent
        m modes.
    points : (p, m) float64
        Motions of the points where the body is joined, driven and measured, in its modes.
    band_hz : float
        Upper end of the band in Hz.

    Returns
    -------
    CostlyModes
        From the highest mode of the body down to the first that serves the band.

    Notes
    -----
    A mode's flexibility is phi phi^T / (w_j^2 - w^2). Without its mass phi phi^T / w_j^2 stays; what goes is, at the
    upper end of the band, phi phi^T / w_j^2 times r / (1 - r), r = (w_b / w_j)^2. That is measured, motion by motion of
    the points, by the static flexibility of all modes there, so that units do not matter.
    """
    band = 2 * np.pi * band_hz
    elastic = component.elastic
    omega = component.omega[elastic]
    compliance = points[:, elastic] ** 2 / omega**2
    static = (points[:, elastic.stop :] ** 2).sum(axis=1)
    flexibility = compliance.sum(axis=1) + static
    felt = flexibility > 0
    # Modes near the band serve it by their frequency alone; their share is not asked for.
    beyond = omega >= _FACTOR * band
    lost = np.zeros_like(omega)
    lost[beyond] = 1 / ((omega[beyond] / band) ** 2 - 1)
    shares = (compliance[felt] / flexibility[felt, None]).max(axis=0, initial=0.0) * lost
    serving = np.flatnonzero(~beyond | (shares > _SHARE))
    first = int(serving[-1]) + 1 if serving.size else 0
    return CostlyModes(
        tuple(
            CostlyMode(
                elastic.start + j, float(omega[j] / (2 * np.pi)), component.kind[elastic.start + j], float(shares[j])
            )
            for j in range(first, omega.size)
        ),
        float(omega[first - 1] / (2 * np.pi)) if first else band_hz,
        _FACTOR,
        _SHARE,
    )
