"""Blocks of vectors laid out by columns: the same numbers, whatever they come from."""

import numpy as np
import pytest

from cmsreduce.linalg.layout import by_columns


@pytest.mark.parametrize("rows", [1, 255, 256, 257, 1000])
@pytest.mark.parametrize("real", [np.float64, np.float32])
def test_numbers_and_layout(rows, real):
    X = np.random.default_rng(1).standard_normal((rows, 7))
    for given in (X, np.asfortranarray(X), X[:, 1:5], np.asfortranarray(X)[:, 1:5], X[::2], X[:, ::-1]):
        turned = by_columns(given, real)
        assert turned.flags.f_contiguous and turned.dtype == real
        assert np.array_equal(turned, given.astype(real))


def test_what_lies_by_columns_is_not_copied():
    X = np.asfortranarray(np.random.default_rng(2).standard_normal((300, 3)))
    assert by_columns(X) is X or np.shares_memory(by_columns(X), X)
