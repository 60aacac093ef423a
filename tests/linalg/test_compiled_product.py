"""Compiled sparse products against scipy's, at every width of the kernels, on any number of threads."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.compiled_product import compiled_product
from cmsreduce.linalg.products import symmetric_product
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings

N = 400


def symmetric(density: float, index: type) -> sp.csc_array:
    """Rows of any length: none, one, hundreds of entries."""
    half = sp.random_array((N, N), density=density, rng=np.random.default_rng(1), format="coo")
    half.data -= 0.5
    A = sp.csc_array(half + half.T)
    A = sp.csc_array(sp.block_diag([A, sp.csc_array((5, 5)), sp.eye_array(3)]))
    A.indices, A.indptr = A.indices.astype(index), A.indptr.astype(index)
    return A


def few(X: np.ndarray) -> np.ndarray:
    raise AssertionError("a block of many columns is not handed on")


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("index", [np.int32, np.int64])
@pytest.mark.parametrize("density", [0.002, 0.1, 0.9])
@pytest.mark.parametrize("columns", [8, 9, 15, 16, 17, 24, 31, 50])
def test_products_are_those_of_scipy(threads, index, density, columns):
    A = symmetric(density, index)
    X = np.random.default_rng(0).standard_normal((A.shape[0], columns))
    with solver_settings(SolverSettings(threads=threads)):
        product = compiled_product(A, few)
    given = X.copy()
    found = product(given)
    longest = np.diff(A.indptr).max()
    assert (abs(found - A @ X) <= longest * 2.0**-53 * (abs(A) @ abs(X))).all()
    np.testing.assert_array_equal(given, X)
    np.testing.assert_array_equal(product(np.asfortranarray(X)), found)
    with solver_settings(SolverSettings(threads=1)):
        np.testing.assert_array_equal(compiled_product(A, few)(X), found)


@pytest.mark.parametrize("shape", [(N,), (N, 1), (N, 3), (N, 0)])
def test_what_fills_no_register_is_handed_on(shape):
    A, handed = sp.csc_array(sp.eye_array(N)), []
    X = np.ones(shape)
    assert compiled_product(A, lambda x: handed.append(x) or 2 * x)(X).shape == shape
    assert handed[0] is X


def test_a_large_body_takes_it():
    """As many digits as MKL or scipy gives, whatever the width."""
    n = 60_000
    rng = np.random.default_rng(2)
    A = sp.diags_array([rng.standard_normal(n - k) for k in range(5)], offsets=range(5), shape=(n, n))
    A = sp.csc_array(A + sp.triu(A, 1).T)
    product = symmetric_product(A)
    for columns in (1, 3, 8, 13):
        X = rng.standard_normal((n, columns))
        assert (abs(product(X) - A @ X) <= 9 * 2.0**-53 * (abs(A) @ abs(X))).all()
