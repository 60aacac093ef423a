"""Singular values of matrices built from known ones, and of weighted columns against exact rational arithmetic."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.gramian import singular_values as module
from cmsreduce.linalg.gramian import weighted_singular_values
from cmsreduce.linalg.gramian.singular_values import singular_values


@pytest.fixture
def in_bands(monkeypatch):
    """Treat every matrix as a large one."""
    monkeypatch.setattr(module, "_LARGE", 1)
    monkeypatch.setattr(module, "_BAND", 8)
    monkeypatch.setattr(module, "_ROWS", 40)


def with_values(sigma: np.ndarray, p: int, q: int) -> np.ndarray:
    """Matrix of these singular values and random vectors."""
    rng = np.random.default_rng(1)
    U, V = (np.linalg.qr(rng.standard_normal((n, sigma.size)))[0] for n in (p, q))
    return (U * sigma) @ V.T


@pytest.mark.parametrize(("p", "q"), [(1, 1), (7, 7), (8, 8), (9, 9), (100, 100), (131, 131), (90, 60), (60, 90)])
def test_values_of_a_matrix_built_from_them(in_bands, p, q):
    sigma = np.logspace(0, -3, min(p, q))
    np.testing.assert_allclose(singular_values(with_values(sigma, p, q)), sigma, rtol=0, atol=4e-15)


def test_a_singular_matrix_has_zeros(in_bands):
    sigma = np.concatenate([np.ones(5), np.zeros(45)])
    found = singular_values(with_values(sigma, 50, 50))
    np.testing.assert_allclose(found, sigma, rtol=0, atol=2e-15)
    np.testing.assert_array_equal(singular_values(np.zeros((50, 50))), np.zeros(50))


@pytest.mark.parametrize("large", [False, True], ids=["one step", "two steps"])
def test_small_values_of_a_graded_matrix_keep_their_digits(request, large):
    """Triangular matrix graded by 1e-20, in random order; its inverse gives the smallest values."""
    if large:
        request.getfixturevalue("in_bands")
    n = 40
    rng = np.random.default_rng(2)
    grade = np.logspace(0, -10, n)
    L = np.tril(0.2 * rng.standard_normal((n, n)), -1) + np.eye(n)
    inverse = la.solve_triangular(L, np.eye(n), lower=True)
    A = grade[:, None] * L * grade
    B = inverse / grade[:, None] / grade
    largest = singular_values(A)[:5]
    smallest = 1 / singular_values(B)[:5][::-1]
    order = rng.permutation(n)
    found = singular_values(A[order][:, rng.permutation(n)])
    assert found[-1] < 1e-19 * found[0]
    np.testing.assert_allclose(found[:5], largest, rtol=1e-12)
    np.testing.assert_allclose(found[-5:], smallest, rtol=1e-11)


def test_the_true_bandwidth(monkeypatch):
    monkeypatch.setattr(module, "_LARGE", 200)
    sigma = np.linspace(2.0, 1e-3, 300)
    np.testing.assert_allclose(singular_values(with_values(sigma, 300, 300)), sigma, rtol=0, atol=1e-14)


SPREADS = [2.0, 1e3, 1e6, 1e9]


def weighted(spread: float, k: int, n: int = 9) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    Q = la.qr(rng.standard_normal((n, n)))[0]
    return rng.permutation(np.geomspace(0.3, 0.3 * spread, n)), Q[:, :k]


def determinant(A: list[list[Fraction]]) -> Fraction:
    """Determinant by exact elimination."""
    A, found = [row[:] for row in A], Fraction(1)
    for k in range(len(A)):
        found *= A[k][k]
        for i in range(k + 1, len(A)):
            factor = A[i][k] / A[k][k]
            A[i] = [a - factor * b for a, b in zip(A[i], A[k], strict=True)]
    return found


@pytest.mark.parametrize("spread", SPREADS)
@pytest.mark.parametrize("k", [1, 4, 9])
def test_each_weighted_value_is_exact_to_its_last_digits(spread: float, k: int) -> None:
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


def test_no_columns_have_no_weighted_values() -> None:
    values, V = weighted_singular_values(np.ones(3), np.zeros((3, 0)))
    assert values.size == 0 and V.shape == (0, 0)
