"""Steps in time against closed forms, and the errors between them."""

import numpy as np
import pytest

from cmsreduce.verify import step_errors, step_response

T, COUNT = 0.01, 400


@pytest.mark.parametrize("zeta", [0.0, 0.02, 0.9])
def test_one_oscillator(zeta: float) -> None:
    """x'' + 2 zeta w x' + w^2 x = u: 1/w^2 (1 - exp(-zeta w t) (cos w_d t + zeta/sqrt(1 - zeta^2) sin w_d t))."""
    w, root = 7.0, np.sqrt(1 - zeta**2)
    A = np.array([[0.0, w], [-w, -2 * zeta * w]])
    y = step_response(A, np.array([[0.0], [1.0]]), np.array([[1 / w, 0.0], [0.0, 1.0]]), np.zeros((2, 1)), T, COUNT)
    t, wd = T * np.arange(COUNT), w * root
    decay = np.exp(-zeta * w * t)
    swing = np.cos(wd * t) + zeta / root * np.sin(wd * t)
    np.testing.assert_allclose(y[:, 0, 0], (1 - decay * swing) / w**2, atol=1e-13)
    np.testing.assert_allclose(y[:, 1, 0], decay * np.sin(wd * t) / wd, atol=1e-12)


def test_a_direct_term_is_there_at_once() -> None:
    y = step_response(np.array([[-1.0]]), np.array([[1.0]]), np.array([[0.0]]), np.array([[0.25]]), T, 3)
    np.testing.assert_array_equal(y.ravel(), [0.25, 0.25, 0.25])


def test_errors_by_hand() -> None:
    full = np.array([0.0, 3.0, -4.0, 0.0])[:, None, None] * np.array([[1.0, 0.0]])
    reduced = full + np.array([0.0, 0.0, 1.0, 0.0])[:, None, None] * np.array([[1.0, 0.0]])
    peak, rms = step_errors(full, reduced)
    np.testing.assert_allclose(peak, [[0.25, np.nan]])
    np.testing.assert_allclose(rms, [[0.2, np.nan]])
