"""Singular values in two steps, against matrices made of known ones, and against LAPACK's."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.gramian import singular_values as module
from cmsreduce.linalg.gramian.singular_values import singular_values


@pytest.fixture
def in_bands(monkeypatch):
    """Take every matrix for a large one."""
    monkeypatch.setattr(module, "_LARGE", 1)
    monkeypatch.setattr(module, "_BAND", 8)
    monkeypatch.setattr(module, "_ROWS", 40)


def turned(sigma: np.ndarray, p: int, q: int) -> np.ndarray:
    """A matrix of these singular values and random vectors."""
    rng = np.random.default_rng(1)
    U, V = (np.linalg.qr(rng.standard_normal((n, sigma.size)))[0] for n in (p, q))
    return (U * sigma) @ V.T


@pytest.mark.parametrize(("p", "q"), [(1, 1), (7, 7), (8, 8), (9, 9), (100, 100), (131, 131), (90, 60), (60, 90)])
def test_values_of_a_matrix_made_of_them(in_bands, p, q):
    sigma = np.logspace(0, -3, min(p, q))
    np.testing.assert_allclose(singular_values(turned(sigma, p, q)), sigma, rtol=0, atol=4e-15)


def test_a_singular_matrix_has_zeros(in_bands):
    sigma = np.concatenate([np.ones(5), np.zeros(45)])
    found = singular_values(turned(sigma, 50, 50))
    np.testing.assert_allclose(found, sigma, rtol=0, atol=2e-15)
    np.testing.assert_array_equal(singular_values(np.zeros((50, 50))), np.zeros(50))


@pytest.mark.parametrize("large", [False, True], ids=["one step", "two steps"])
def test_small_values_of_a_graded_matrix_keep_their_digits(request, large):
    """Triangular, graded by 1e-20, in random order: the inverse by substitution has the inverses of the smallest."""
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


def test_bands_as_wide_as_they_are(monkeypatch):
    monkeypatch.setattr(module, "_LARGE", 200)
    sigma = np.linspace(2.0, 1e-3, 300)
    np.testing.assert_allclose(singular_values(turned(sigma, 300, 300)), sigma, rtol=0, atol=1e-14)
