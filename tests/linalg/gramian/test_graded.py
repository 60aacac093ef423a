"""Singular values of weighted orthonormal columns, against exact rational arithmetic and inverses."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.gramian import weighted_singular_values

SPREADS = [2.0, 1e3, 1e6, 1e9]


def weighted(spread: float, k: int, n: int = 9) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    Q = la.qr(rng.standard_normal((n, n)))[0]
    return rng.permutation(np.geomspace(0.3, 0.3 * spread, n)), Q[:, :k]


def determinant(A: list[list[Fraction]]) -> Fraction:
    """Exact, by elimination."""
    A, found = [row[:] for row in A], Fraction(1)
    for k in range(len(A)):
        found *= A[k][k]
        for i in range(k + 1, len(A)):
            factor = A[i][k] / A[k][k]
            A[i] = [a - factor * b for a, b in zip(A[i], A[k], strict=True)]
    return found


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("k", [1, 4, 9])
def test_every_value_is_an_exact_root_to_its_own_last_digits(spread: float, k: int) -> None:
    """det(A^T A - s^2) changes sign within a few roundings of s, in rational arithmetic."""
    weight, Q = weighted(spread, k)
    values, V = weighted_singular_values(weight, Q)
    A = [[Fraction(float(w)) * Fraction(float(q)) for q in row] for w, row in zip(weight, Q, strict=True)]
    gram = [[sum(row[i] * row[j] for row in A) for j in range(k)] for i in range(k)]
    for value in values:
        signs = []
        for side in (-1, 1):
            square = (Fraction(float(value)) * (1 + side * Fraction(1, 10**14))) ** 2
            shifted = [[gram[i][j] - (square if i == j else 0) for j in range(k)] for i in range(k)]
            signs.append(determinant(shifted) > 0)
        assert signs[0] != signs[1], (value, spread)
    np.testing.assert_allclose(V.T @ V, np.eye(k), atol=1e-13)
    np.testing.assert_allclose(la.norm(weight[:, None] * (Q @ V), axis=0), values, rtol=1e-13)
    assert (np.diff(values) >= 0).all()


def test_no_columns_have_no_values() -> None:
    values, V = weighted_singular_values(np.ones(3), np.zeros((3, 0)))
    assert values.size == 0 and V.shape == (0, 0)
