"""Step limits against the leading terms of the phase errors, and against runs of the integrators."""

import numpy as np
import pytest

from cmsreduce.mechanics import INTEGRATORS, numerical_damping
from cmsreduce.mechanics.integrator_steps import SPECTRAL_RADIUS, STABLE, step_limit

SPREAD = (1 - SPECTRAL_RADIUS) / (1 + SPECTRAL_RADIUS)
# Coefficient and power of w h.
LEADING = {
    "central_difference": (1 / 24, 2),
    "modified_euler": (1 / 24, 2),
    "trapezoidal": (1 / 12, 2),
    "ab2": (5 / 12, 2),
    "rk4": (1 / 120, 4),
    "generalised_alpha": (1 / 12 + 3 / 8 * SPREAD**2, 2),
}


@pytest.mark.parametrize("name", INTEGRATORS)
def test_fine_steps_follow_the_leading_term(name):
    factor, power = LEADING[name]
    assert step_limit(name, 1e-6) == pytest.approx((1e-6 / factor) ** (1 / power), rel=5e-3)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-6])
@pytest.mark.parametrize(
    ("name", "angle"),
    [("central_difference", lambda x: 2 * np.arcsin(x / 2)), ("trapezoidal", lambda x: 2 * np.arctan(x / 2))],
)
def test_the_limit_is_where_the_error_is_that_large(name, angle, accuracy):
    """Frequency in closed form: sin(w' h / 2) = w h / 2, and tan(w' h / 2) = w h / 2."""
    x = step_limit(name, accuracy)
    assert abs(angle(x) / x - 1) == pytest.approx(accuracy, rel=1e-9)


def trajectory(name, h, steps):
    """Displacement of x'' = -x from x = 1 at rest."""
    x, v, a, past = 1.0, 0.0, -1.0, None
    flow = np.array([[0.0, 1.0], [-1.0, 0.0]])
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
        elif name == "rk4":
            y = np.array([x, v])
            k1 = flow @ y
            k2 = flow @ (y + 0.5 * h * k1)
            k3 = flow @ (y + 0.5 * h * k2)
            k4 = flow @ (y + h * k3)
            x, v = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        elif name == "generalised_alpha":
            # Chung and Hulbert: (1 - am) a' + am a + (1 - af) x' + af x = 0.
            am, af = (2 * SPECTRAL_RADIUS - 1) / (SPECTRAL_RADIUS + 1), SPECTRAL_RADIUS / (SPECTRAL_RADIUS + 1)
            gamma, beta = 0.5 - am + af, 0.25 * (1 - am + af) ** 2
            free = x + h * v + h * h * (0.5 - beta) * a
            new = -(am * a + (1 - af) * free + af * x) / (1 - am + (1 - af) * beta * h * h)
            x, v, a = free + beta * h * h * new, v + h * ((1 - gamma) * a + gamma * new), new
        else:
            v -= h * x
            x += h * v
    return np.array(found)


def measured(x, h):
    """Frequency between zeros."""
    t = h * np.arange(x.size)
    down = np.flatnonzero((x[:-1] > 0) & (x[1:] <= 0))
    zeros = t[down] + h * x[down] / (x[down] - x[down + 1])
    return 2 * np.pi * (zeros.size - 1) / (zeros[-1] - zeros[0])


@pytest.mark.parametrize("accuracy", [0.01, 0.001])
@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "central_difference"])
def test_an_integrator_that_is_run_misses_the_frequency_by_that_much(name, accuracy):
    h = step_limit(name, accuracy)
    assert abs(measured(trajectory(name, h, 2000), h) - 1) == pytest.approx(accuracy, rel=0.05)


@pytest.mark.parametrize("name", [name for name in INTEGRATORS if name != "central_difference"])
def test_the_amplitude_of_an_integrated_oscillation_follows_the_numerical_damping(name):
    """Root mean squares of two windows, each many periods long."""
    h = step_limit(name, 0.01)
    x = trajectory(name, h, 8000)
    first, last = (np.sqrt(np.mean(part**2)) for part in (x[:4000], x[4000:]))
    turns = 4000 * np.angle(INTEGRATORS[name](h))
    assert -np.log(last / first) / turns == pytest.approx(numerical_damping(name, h), rel=0.02, abs=2e-5)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_beyond_its_limit_an_oscillation_grows(name):
    limit = STABLE[name]
    if np.isfinite(limit):
        beyond = trajectory(name if name != "central_difference" else "modified_euler", 1.01 * limit + 0.3, 400)
        assert abs(beyond[-200:]).max() > 1.05 * abs(beyond[:5]).max()
    if limit > 0:
        within = trajectory("modified_euler" if name == "central_difference" else name, min(0.99 * limit, 50.0), 4000)
        assert abs(within[-200:]).max() < 20 * abs(within[:5]).max()
