"""Step limits against the leading terms of the phase errors, and against integrators that are run."""

import numpy as np
import pytest

from cmsreduce.linalg.integrator_steps import INTEGRATORS, step_limit

LEADING = {"central_difference": 1 / 24, "modified_euler": 1 / 24, "trapezoidal": 1 / 12, "ab2": 5 / 12}


@pytest.mark.parametrize("name", INTEGRATORS)
def test_fine_steps_follow_the_leading_term(name):
    assert step_limit(name, 1e-6) == pytest.approx(np.sqrt(1e-6 / LEADING[name]), rel=1e-3)


def trajectory(name, h, steps):
    """Displacement of x'' = -x from x = 1 at rest."""
    x, v, past = 1.0, 0.0, None
    found = []
    for _ in range(steps):
        found.append(x)
        if name == "trapezoidal":
            d = 1 + h * h / 4
            x, v = ((1 - h * h / 4) * x + h * v) / d, ((1 - h * h / 4) * v - h * x) / d
        elif name == "ab2":
            slope = np.array([v, -x])
            step = slope if past is None else 1.5 * slope - 0.5 * past
            past = slope
            x, v = np.array([x, v]) + h * step
        else:
            v -= h * x
            x += h * v
    return np.array(found)


@pytest.mark.parametrize("accuracy", [0.01, 0.001])
@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "central_difference"])
def test_an_integrator_that_is_run_misses_the_frequency_by_that_much(name, accuracy):
    h = step_limit(name, accuracy)
    x = trajectory(name, h, 2000)
    t = h * np.arange(x.size)
    down = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    zeros = t[down] + h * x[down] / (x[down] - x[down + 1])
    frequency = 2 * np.pi * (zeros.size - 1) / (zeros[-1] - zeros[0])
    assert abs(frequency - 1) == pytest.approx(accuracy, rel=0.05)
