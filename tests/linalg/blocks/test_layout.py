"""Blocks of vectors by columns or by rows hold the same numbers, whatever their layout was."""

import numpy as np
import pytest

from cmsreduce.linalg.blocks import by_columns, by_rows, put


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
