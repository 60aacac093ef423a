"""Products of tall blocks against numpy's, however the blocks lie."""

import numpy as np
import pytest

from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings
from cmsreduce.linalg.tall_products import column_products, inner, less


def laid(n: int, columns: int, how: str, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    if how == "rows":
        return random.standard_normal((n, columns))
    if how == "columns":
        return np.asfortranarray(random.standard_normal((n, columns)))
    if how == "some of the columns":
        return np.asfortranarray(random.standard_normal((n, columns + 3)))[:, 1 : columns + 1]
    if how == "some of each row":
        return random.standard_normal((n, columns + 3))[:, 2 : columns + 2]
    return random.standard_normal((n, 2 * columns))[:, ::2]


LAYOUTS = ("rows", "columns", "some of the columns", "some of each row", "every second")


@pytest.mark.parametrize("left", LAYOUTS)
@pytest.mark.parametrize("right", LAYOUTS)
@pytest.mark.parametrize(
    ("n", "m", "k"), [(20_000, 7, 4), (30_001, 1, 5), (25_000, 3, 0), (100, 6, 2), (50_001, 11, 5)]
)
def test_every_layout(left, right, n, m, k):
    V, W = laid(n, m, left, 1), laid(n, k, right, 2)
    found = inner(V, W)
    assert found.shape == (m, k)
    np.testing.assert_allclose(found, V.T @ W, rtol=0, atol=1e-13 * n)


@pytest.mark.parametrize("left", LAYOUTS)
@pytest.mark.parametrize(
    ("n", "m", "k"), [(300, 30, 5), (50_001, 30, 5), (50_001, 24, 17), (50_001, 3, 40), (60_000, 9, 0)]
)
def test_what_is_taken_from_a_block(left, n, m, k):
    V, W, c = laid(n, m, left, 1), laid(n, k, "some of the columns", 2), laid(m, k, "columns", 3)
    wanted = W - V @ c
    found = less(W, V, c)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * m)
    assert found is W or np.shares_memory(found, W)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_a_tall_product_is_the_same_each_time(threads):
    V, W = laid(50_001, 40, "columns", 1), laid(50_001, 8, "rows", 2)
    with solver_settings(SolverSettings(threads=threads)):
        first, second = inner(V, W), inner(V, W)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_allclose(first, V.T @ W, rtol=0, atol=1e-13 * 50_001)


@pytest.mark.parametrize("left", LAYOUTS)
@pytest.mark.parametrize("right", LAYOUTS)
@pytest.mark.parametrize(("n", "k"), [(9_000, 5), (7, 3), (100, 0)])
def test_products_column_by_column(left, right, n, k):
    X, Y = laid(n, k, left, 1), laid(n, k, right, 2)
    np.testing.assert_allclose(column_products(X, Y), (X * Y).sum(axis=0), rtol=0, atol=1e-13 * n)
