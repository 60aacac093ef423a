"""Longest steps at which integrators keep a frequency, from what each makes of an undamped oscillation."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from scipy.optimize import brentq

__all__ = ["INTEGRATORS", "STABLE", "step_limit"]


def _central_difference(x: float) -> float:
    # x_{n+1} - 2 x_n + x_{n-1} = -(w h)^2 x_n: sin(w' h / 2) = w h / 2.
    return 2 * float(np.arcsin(x / 2)) / x


def _trapezoidal(x: float) -> float:
    # (1 - i w h / 2) x_{n+1} = (1 + i w h / 2) x_n: tan(w' h / 2) = w h / 2, whatever the step.
    return 2 * float(np.arctan(x / 2)) / x


def _adams_bashforth_2(x: float) -> float:
    # z^2 - (1 + 3 i w h / 2) z + i w h / 2 = 0, of whose roots the larger is the motion.
    roots = np.roots([1.0, -(1 + 1.5j * x), 0.5j * x])
    return float(np.angle(roots[abs(roots).argmax()])) / x


INTEGRATORS: Mapping[str, Callable[[float], float]] = {
    "central_difference": _central_difference,
    "modified_euler": _central_difference,
    "trapezoidal": _trapezoidal,
    "ab2": _adams_bashforth_2,
}
"""Frequency that each gives over the true one, of w h; modified Euler, the velocity first and the displacement with the
new one, steps through the same displacements as central differences."""

STABLE: Mapping[str, float] = {"central_difference": 2.0, "modified_euler": 2.0, "trapezoidal": np.inf, "ab2": 0.0}
"""Largest w h at which an undamped oscillation does not grow; AB-2 lets it grow at any."""

# Below this the phase errors are those of their leading terms, and round-off of a ratio near 1 begins to show.
_SMALLEST = 1e-5
_LARGEST = 1.0


def step_limit(integrator: str, accuracy: float) -> float:
    """Longest step in units of 1 / w that keeps a frequency w.

    Parameters
    ----------
    integrator : str
        One of ``INTEGRATORS``.
    accuracy : float
        Relative error of the frequency, from 1e-8 to 0.04.

    Examples
    --------
    >>> [round(step_limit(name, 0.01), 3) for name in ("modified_euler", "trapezoidal", "ab2")]
    [0.483, 0.35, 0.154]

    Notes
    -----
    Leading terms: (w h)^2 / 24, / 12, and 5 / 12 (w h)^2 for AB-2, which alone make 0.490, 0.346 and 0.155 of 1 %.
    """
    ratio = INTEGRATORS[integrator]
    return float(brentq(lambda x: abs(ratio(x) - 1) - accuracy, _SMALLEST, _LARGEST, xtol=1e-12))
