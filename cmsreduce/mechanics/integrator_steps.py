"""Longest steps of integrators for a given error of a frequency, from their effect on an undamped oscillation."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

__all__ = ["ACCURACIES", "INTEGRATORS", "SPECTRAL_RADIUS", "STABLE", "advised_steps", "numerical_damping", "step_limit"]

ACCURACIES: Mapping[str, float] = {"1_percent": 1e-2, "0.1_percent": 1e-3}
"""Relative errors of a frequency for which steps are advised."""

SPECTRAL_RADIUS = 0.9
"""Spectral radius of generalised alpha at infinite frequency: the default of multibody codes such as Exudyn."""


def _central_difference(x: float) -> complex:
    # x_{n+1} - 2 x_n + x_{n-1} = -(w h)^2 x_n: sin(w' h / 2) = w h / 2, and no damping below the limit of stability.
    return complex(np.exp(2j * np.arcsin(x / 2)))


def _trapezoidal(x: float) -> complex:
    # (1 - i w h / 2) x_{n+1} = (1 + i w h / 2) x_n, whatever the step.
    return (1 + 0.5j * x) / (1 - 0.5j * x)


def _adams_bashforth_2(x: float) -> complex:
    # z^2 - (1 + 3 i w h / 2) z + i w h / 2 = 0; the larger root is the motion.
    sum_of_roots = 1 + 1.5j * x
    apart = cmath.sqrt(sum_of_roots**2 - 2j * x)
    return max(0.5 * (sum_of_roots + apart), 0.5 * (sum_of_roots - apart), key=abs)


def _runge_kutta_4(x: float) -> complex:
    # The exponential series of i w h up to its fourth power.
    z = 1j * x
    return 1 + z * (1 + z / 2 * (1 + z / 3 * (1 + z / 4)))


def _generalised_alpha(x: float) -> complex:
    rho = SPECTRAL_RADIUS
    of_mass, of_force = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
    gamma = 0.5 - of_mass + of_force
    beta = 0.25 * (1 - of_mass + of_force) ** 2
    # Displacement, velocity / w and acceleration / w^2: Newmark's formulas, and equilibrium between the two instants.
    new = np.array([[1, 0, -beta * x**2], [0, 1, -gamma * x], [1 - of_force, 0, 1 - of_mass]])
    change = np.array([[0, -x, -0.5 * x**2], [0, 0, -x], [1, 0, 1]])
    # Roots less one: for short steps they keep the digits that the roots would lose.
    roots = -np.linalg.eigvals(np.linalg.solve(new, change))
    # The oscillation is the complex pair; the third root is real and decays.
    return complex(1 + roots[roots.imag.argmax()])


INTEGRATORS: Mapping[str, Callable[[float], complex]] = {
    "central_difference": _central_difference,
    "modified_euler": _central_difference,
    "trapezoidal": _trapezoidal,
    "ab2": _adams_bashforth_2,
    "rk4": _runge_kutta_4,
    "generalised_alpha": _generalised_alpha,
}
"""Factor of one step on exp(i w t), as a function of w h. Modified Euler (velocity first, then the displacement with
the new velocity) has the displacements of central differences. Generalised alpha: Chung and Hulbert (1993)."""

STABLE: Mapping[str, float] = {
    "central_difference": 2.0,
    "modified_euler": 2.0,
    "trapezoidal": np.inf,
    "ab2": 0.0,
    "rk4": 2 * np.sqrt(2),
    "generalised_alpha": np.inf,
}
"""Largest w h at which an undamped oscillation does not grow; with AB-2 it always grows."""

# Below this w h the phase errors equal their leading terms, and round-off of a ratio near 1 is visible.
_SMALLEST = 1e-5
# Factor from one trial step to the next.
_WIDER = 1.25
# Halvings of the last trial step that reach the digits of a double.
_HALVINGS = 50


@cache
def step_limit(integrator: str, accuracy: float) -> float:
    """Longest step in units of 1 / w for a given error of a frequency w.

    Parameters
    ----------
    integrator : str
        One of ``INTEGRATORS``.
    accuracy : float
        Relative error of the frequency, from 1e-8 to 0.01.

    Examples
    --------
    >>> [round(step_limit(name, 0.01), 3) for name in ("modified_euler", "trapezoidal", "ab2", "rk4")]
    [0.483, 0.35, 0.154, 1.233]

    Notes
    -----
    Leading terms: (w h)^2 / 24, / 12, and 5 / 12 (w h)^2 for AB-2, which alone make 0.490, 0.346 and 0.155 of 1 %;
    (w h)^4 / 120 for the Runge-Kutta method of fourth order, whose damping is larger (`numerical_damping`);
    (w h)^2 (1 / 12 + 3 e^2 / 8), e = (1 - rho) / (1 + rho), for generalised alpha.
    """

    def excess(x: float) -> float:
        # The frequency of the integrated oscillation over the true one, less 1.
        return abs(float(np.angle(INTEGRATORS[integrator](x))) / x - 1) - accuracy

    x = _SMALLEST
    while excess(_WIDER * x) < 0:
        x *= _WIDER
    low, high = x, _WIDER * x
    # Bisection: to load a root finder from a library takes longer than all limits together.
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    return high


def advised_steps(highest_omega: float) -> dict[str, dict[str, float]]:
    """Longest steps of all integrators for the highest frequency of a model.

    Parameters
    ----------
    highest_omega : float
        Highest frequency in rad per unit of time.

    Returns
    -------
    dict
        For each integrator, in the unit of time: ``stable``, the step above which an undamped oscillation grows
        (infinite if none grows, 0 if all grow), and a step for each of ``ACCURACIES``; empty if nothing oscillates.
    """
    if highest_omega <= 0:
        return {}
    return {
        name: {
            "stable": STABLE[name] / highest_omega,
            **{label: step_limit(name, accuracy) / highest_omega for label, accuracy in ACCURACIES.items()},
        }
        for name in INTEGRATORS
    }


def numerical_damping(integrator: str, x: float) -> float:
    """Numerical damping ratio of an undamped oscillation at w h = x; negative if the oscillation grows."""
    z = INTEGRATORS[integrator](x)
    return float(-np.log(abs(z)) / np.angle(z))
