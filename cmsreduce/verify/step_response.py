"""Response to a step in time, of a full and a reduced model."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

__all__ = ["step_errors", "step_response"]

Array = NDArray[np.float64]

# A pair whose response is below this share of the strongest of its output is rounding.
_SILENT = 1e-10


def step_response(A: Array, B: Array, C: Array, D: Array, step: float, count: int) -> Array:
    """Response to a unit step on each input at time zero, exact at the instants asked for.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, inputs), (outputs, n), (outputs, inputs) float64
        x' = A x + B u, y = C x + D u; in modal states, it is the superposition of the modes.
    step : float
        Time between instants in seconds.
    count : int
        Instants, from time zero.

    Returns
    -------
    (count, outputs, inputs) float64

    Notes
    -----
    With a constant input, x(t + h) = exp(A h) x(t) + int exp(A s) ds B without any error of discretisation; both are
    in one exponential (Van Loan 1978).
    """
    n, inputs = B.shape
    both = la.expm(np.block([[A, B], [np.zeros((inputs, n + inputs))]]) * step)
    F, G = both[:n, :n], both[:n, n:]
    x, found = np.zeros((n, inputs)), np.empty((count, C.shape[0], inputs))
    for k in range(count):
        found[k] = C @ x + D
        x = F @ x + G
    return found


def step_errors(full: Array, reduced: Array) -> tuple[Array, Array]:
    """Errors of a step response.

    Parameters
    ----------
    full, reduced : (t, outputs, inputs) float64
        At the same instants.

    Returns
    -------
    peak : (outputs, inputs) float64
        Largest difference over the largest full response; NaN for a silent pair.
    rms : (outputs, inputs) float64
        Root mean square of the difference over that of the full response; NaN for a silent pair.
    """
    miss = reduced - full
    high, mean = abs(full).max(axis=0, initial=0.0), np.sqrt(np.mean(full**2, axis=0))
    silent = high <= _SILENT * high.max(axis=1, initial=0.0, keepdims=True)
    peak, rms = (
        np.where(silent, np.nan, part / np.where(silent, 1.0, size))
        for part, size in ((abs(miss).max(axis=0, initial=0.0), high), (np.sqrt(np.mean(miss**2, axis=0)), mean))
    )
    return np.asarray(peak), np.asarray(rms)
