"""Running sum of modal gains from an actuator to a sensor: which modes make up the static response."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.gain_sum import GainSum, HighGain

__all__ = ["GainSum", "HighGain", "gain_sum"]

Array = NDArray[np.float64]

# Gains between channels that no mode joins are rounding of what each of them does with the modes.
_APART = 1e-10


def gain_sum(omega: Array, B: Array, C: Array, static: Array | None = None) -> GainSum:
    """Gains of modes of unit modal mass.

    Parameters
    ----------
    omega : (k,) float64
        Elastic frequencies in rad/s, ascending.
    B : (k, inputs) float64
        Modal inputs.
    C : (outputs, k) float64
        Modal displacement outputs; of a rate sensor, the displacement whose rate it is.
    static : (outputs, inputs) float64, optional
        Gain of static modes.
    """
    gain = np.einsum("yk,ku,k->kyu", C, B, 1 / omega**2)
    direct = np.zeros(gain.shape[1:]) if static is None else static
    reach = np.outer(np.linalg.norm(C / omega, axis=1), np.linalg.norm(B / omega[:, None], axis=0))
    joined = abs(gain).sum(axis=0) > _APART * reach
    return GainSum(omega / (2 * np.pi), np.where(joined, gain, 0.0), direct)
