"""MKL's sparse products against scipy's."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.blocks import products as module
from cmsreduce.linalg.blocks.products import mkl_product
from cmsreduce.linalg.machine import SolverSettings, solver_settings

pytestmark = pytest.mark.pardiso
N = 400


def symmetric(index: type = np.int32) -> sp.csc_array:
    half = sp.random_array((N, N), density=0.02, rng=np.random.default_rng(1), format="csc")
    A = sp.csc_array(half + half.T)
    return sp.csc_array((A.data, A.indices.astype(index), A.indptr.astype(index)), shape=A.shape)


@pytest.mark.parametrize("index", [np.int32, np.int64])
@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("shape", [(N,), (N, 1), (N, 7), (N, 0)], ids=str)
def test_products_are_scipys(shape, order, threads, index):
    A = symmetric(index)
    X = np.asarray(np.random.default_rng(2).standard_normal(shape), order=order)
    with solver_settings(SolverSettings(threads=threads)):
        product = mkl_product(A)
        assert product is not None
        found = product(X)
    size = abs(A) @ abs(X)
    assert found.shape == X.shape and (abs(found - A @ X) <= 1e-15 * size).all()


def test_the_matrix_outlives_its_name():
    product = mkl_product(symmetric())
    assert product is not None
    X = np.eye(N)
    np.testing.assert_array_equal(product(X), symmetric().toarray())


def test_without_mkl_there_is_none(monkeypatch):
    monkeypatch.setattr(module, "mkl_library", lambda: None)
    assert mkl_product(symmetric()) is None
