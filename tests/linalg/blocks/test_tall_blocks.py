"""Products of tall blocks in every layout, compared with numpy's; copies in another layout hold the same numbers."""

from itertools import product

import numpy as np
import pytest

from cmsreduce.linalg.blocks import (
    by_columns,
    by_rows,
    column_products,
    inner,
    inner_of_all,
    less,
    less_all,
    put,
    times,
)
from cmsreduce.linalg.blocks.tall_blocks import combination
from cmsreduce.linalg.machine import SolverSettings, solver_settings


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
    ("n", "m", "k"), [(20_000, 7, 4), (30_001, 1, 5), (25_000, 3, 0), (100, 6, 2), (50_001, 11, 5), (20_001, 24, 5)]
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
def test_difference_in_a_block(left, n, m, k):
    V, W, c = laid(n, m, left, 1), laid(n, k, "some of the columns", 2), laid(m, k, "columns", 3)
    wanted = W - V @ c
    found = less(W, V, c)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * m)
    assert found is W or np.shares_memory(found, W)


@pytest.mark.parametrize("left", LAYOUTS)
@pytest.mark.parametrize("n", [300, 20_001, 50_001])
@pytest.mark.parametrize("k", [4, 8, 30])
def test_difference_in_a_block_by_rows(left, n, k):
    V, W, c = laid(n, 30, left, 1), laid(n, k, "rows", 2), laid(30, k, "columns", 3)
    wanted = W - V @ c
    found = less(W, V, c)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13 * 30)
    assert np.shares_memory(found, W)


@pytest.mark.parametrize(
    ("n", "how"), [*product([300, 20_001, 50_001], LAYOUTS[:4]), (200_003, LAYOUTS[0]), (200_003, LAYOUTS[1])]
)
def test_several_blocks(n, how):
    """Blocks of several widths, one of them a single column, and right-hand sides in several layouts."""
    widths = (8, 3, 1, 8, 24)
    blocks = [laid(n, width, LAYOUTS[i], i) for i, width in enumerate(widths)]
    V, W = np.hstack(blocks), laid(n, 8, how, 9)
    for few in (4, 5):
        np.testing.assert_allclose(inner_of_all(blocks[:few], W), np.hstack(blocks[:few]).T @ W, rtol=0, atol=1e-13 * n)
    c = laid(V.shape[1], 8, "rows", 10)
    for given in (np.array(W, order="C"), np.array(W, order="F")):
        found = less_all(given, blocks, c)
        np.testing.assert_allclose(found, W - V @ c, rtol=0, atol=1e-13 * V.shape[1])
        assert np.shares_memory(found, given)
    assert inner_of_all([], W).shape == (0, 8)
    np.testing.assert_array_equal(less_all(W.copy(), [], np.empty((0, 8))), W)


@pytest.mark.parametrize("how", LAYOUTS)
@pytest.mark.parametrize("n", [300, 50_001])
@pytest.mark.parametrize("k", [0, 1, 5, 8, 11])
def test_a_block_times_a_small_matrix(how, n, k):
    W, C = laid(n, 11, how, 1), laid(11, k, "rows", 2)
    wanted = W @ C
    found = times(W, C)
    assert found.shape == (n, k) and np.shares_memory(found, W) == (k > 0)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-13)


@pytest.mark.parametrize("n", [300, 50_001])
def test_a_combination_of_blocks(n):
    blocks = [laid(n, 8, how, i) for i, how in enumerate(LAYOUTS[:4])]
    S = laid(32, 50, "columns", 9)
    found = combination(blocks, S)
    assert found.flags.f_contiguous
    np.testing.assert_allclose(found, np.hstack(blocks) @ S, rtol=0, atol=1e-13 * 32)


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


@pytest.mark.parametrize("rows", [1, 255, 256, 257, 1000, 10_001])
@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_numbers_and_layout(rows, real):
    X = np.random.default_rng(1).standard_normal((rows, 7))
    for given in (X, np.asfortranarray(X), X[:, 1:5], np.asfortranarray(X)[:, 1:5], X[::2], X[:, ::-1]):
        turned = by_columns(given, real)
        assert turned.flags.f_contiguous and turned.dtype == real
        assert np.array_equal(turned, given.astype(real))
        turned = by_rows(given)
        assert turned.flags.c_contiguous and np.array_equal(turned, given)


def test_what_lies_by_columns_is_not_copied():
    X = np.asfortranarray(np.random.default_rng(2).standard_normal((300, 3)))
    assert by_columns(X) is X or np.shares_memory(by_columns(X), X)
    Y = np.ascontiguousarray(X)
    assert by_rows(Y) is Y


@pytest.mark.parametrize("rows", [3, 10_001])
def test_a_block_is_copied_into_its_place(rows):
    X = np.random.default_rng(3).standard_normal((rows, 4))
    place = np.full((rows, 9), np.nan, order="F")
    put(X, place[:, 2:6], np.arange(4.0))
    np.testing.assert_array_equal(place[:, 2:6], X * np.arange(4.0))
    put(X, place[:, 2:6])
    np.testing.assert_array_equal(place[:, 2:6], X)
    assert np.isnan(place[:, [0, 1, 6, 7, 8]]).all()
