"""Residuals of modes: the formula for random shapes, and zero for exact modes."""

import numpy as np
import pytest

from cmsreduce.linalg.eigen.inverse_iteration import eigen_residuals
from tests.linalg.eigen.test_eigenpairs import rod, rod_omega


@pytest.mark.parametrize("n", [50, 9_001])
@pytest.mark.parametrize("order", ["C", "F"])
def test_residuals_of_random_shapes(n, order):
    K, M = rod(n)
    lam = rod_omega(n)[:3] ** 2
    X = np.array(np.random.default_rng(0).standard_normal((n, 3)), order=order)
    given = X.copy(order="K")
    found = eigen_residuals(lambda x: K @ x, lambda x: M @ x, X, lam)
    np.testing.assert_allclose(found, K @ X - (M @ X) * lam, atol=1e-13 * abs(K).max() * abs(X).max())
    np.testing.assert_array_equal(X, given)


@pytest.mark.parametrize("n", [50, 9_001])
def test_exact_modes_have_no_residual(n):
    """The modes of the discrete rod are sines at its nodes."""
    K, M = rod(n)
    X = np.sin(np.outer(np.arange(1, n + 1), (2 * np.arange(1, 4) - 1) * np.pi / (2 * n)))
    residual = eigen_residuals(lambda x: K @ x, lambda x: M @ x, X, rod_omega(n)[:3] ** 2)
    assert abs(residual).max() < 1e-13 * abs(K).max()
