"""Products on any number of threads give the same digits; they agree with scipy's to the rounding of a row's sum."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.blocks import absolute_product, products, symmetric_product
from cmsreduce.linalg.machine import SolverSettings, solver_settings

N = 3000


def band(width: int) -> sp.csc_array:
    """Symmetric band of random entries, 2 width + 1 to a row."""
    rng = np.random.default_rng(width)
    half = [rng.standard_normal(N - k) for k in range(width + 1)]
    offsets = list(range(width + 1))
    upper = sp.diags_array(half, offsets=offsets, shape=(N, N))
    return sp.csc_array(upper + sp.triu(upper, 1).T)


def arrow() -> sp.csc_array:
    """Matrix with half of its entries in a hundred rows and columns: equal shares of rows are unequal work."""
    rng = np.random.default_rng(1)
    dense = sp.coo_array(rng.standard_normal((100, N)))
    top = sp.csr_array((dense.data, dense.coords), shape=(N, N))
    return sp.csc_array(sp.triu(top) + sp.triu(top, 1).T + sp.eye_array(N))


def hollow() -> sp.csc_array:
    """Band with rows without entries at both ends."""
    return sp.block_diag([sp.csc_array((500, 500)), band(40)[500:-500, 500:-500], sp.csc_array((500, 500))], "csc")


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize(
    "A", [band(2), band(40), arrow(), hollow()], ids=["few entries", "band", "arrow", "empty rows at both ends"]
)
@pytest.mark.parametrize("columns", [None, 1, 5])
def test_every_thread_count_gives_the_same_digits(A, threads, columns):
    rng = np.random.default_rng(0)
    X = rng.standard_normal(N if columns is None else (N, columns))
    with solver_settings(SolverSettings(threads=1)):
        alone = symmetric_product(A)(X)
    with solver_settings(SolverSettings(threads=threads)):
        product = symmetric_product(A)
        for given in (X, np.asfortranarray(X)):
            assert np.array_equal(product(given), alone)
    # MKL adds eight terms of a row at a time if the processor can.
    longest = np.diff(A.indptr).max()
    assert (abs(alone - A @ X) <= longest * 2.0**-53 * (abs(A) @ abs(X))).all()


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_products_with_absolute_values(threads):
    X = np.random.default_rng(0).standard_normal((N, 4))
    whole = np.arange(4 * N).reshape(N, 4)
    for A in (band(40), hollow()):
        assert (A.data < 0).any()
        for given in (np.asfortranarray(X), X[:, 0], X.astype(np.float32), whole):
            with solver_settings(SolverSettings(threads=threads)):
                found = absolute_product(A)(given)
            expected = abs(A) @ given.astype(np.float64)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * max(1.0, abs(given).max()))


def test_rows_that_mkl_refuses_or_cannot_read(monkeypatch):
    A, X = band(40), np.random.default_rng(0).standard_normal((N, 4))
    long = sp.csc_array((A.data.astype(np.float32), A.indices.astype(np.int64), A.indptr.astype(np.int64)), A.shape)
    np.testing.assert_allclose(absolute_product(long)(X), abs(long) @ X, rtol=1e-12, atol=1e-12)

    def refused(*_):
        raise ValueError("MKL refuses the sparse matrix")

    monkeypatch.setattr(products, "SparseMatrix", refused)
    np.testing.assert_allclose(absolute_product(A)(X), abs(A) @ X, rtol=0, atol=1e-13)


def test_a_small_product():
    A = sp.csc_array(np.array([[2.0, -1.0], [-1.0, 3.0]]))
    np.testing.assert_array_equal(symmetric_product(A)(np.array([1.0, 2.0])), [0.0, 5.0])
