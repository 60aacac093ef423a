"""Energies that are what large terms leave of each other, against rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.mechanics import energies


@pytest.mark.parametrize("n", [3, 40])
def test_a_soft_shape_of_a_stiff_chain(n: int) -> None:
    """x^T K x of springs of 1e9 that hardly stretch; doubles keep nine digits of it, extended precision twelve."""
    rng = np.random.default_rng(n)
    K = 1e9 * sp.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1], format="csc")
    X = 1.0 + 1e-4 * rng.standard_normal((n, 20))
    K = sp.csc_array(K - sp.csc_array(([1e9, 1e9], ([0, n - 1], [0, n - 1])), shape=(n, n)))
    exact = []
    for x in X.T:
        terms = [Fraction(float(v)) for v in x]
        exact.append(float(10**9 * sum((a - b) ** 2 for a, b in zip(terms[1:], terms[:-1], strict=True))))
    digits = float(np.finfo(np.longdouble).eps) / float(np.finfo(float).eps)
    np.testing.assert_allclose(energies(K, X), exact, rtol=max(1e-7 * digits, 1e-12))
    np.testing.assert_allclose(energies(K.toarray(), X), energies(K, X), rtol=max(1e-7 * digits, 1e-12))
