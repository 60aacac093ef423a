"""Frequencies paired by shape."""

import numpy as np
import pytest

from cmsreduce.verify import pair_frequencies

FULL = 2 * np.pi * np.array([1.0, 2.0, 2.01, 5.0])


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2]], ids=str)
def test_permuted_modes_find_their_partners(order):
    reduced = FULL[order] * np.array([1.001, 1.0, 1.002, 1.0])
    cross = np.eye(4)[:, order] * np.array([1, -1, 1, -1])
    pairs = pair_frequencies(FULL, reduced, cross, 100.0)
    np.testing.assert_allclose(pairs.full_hz, FULL[order] / (2 * np.pi))
    np.testing.assert_allclose(pairs.reduced_hz, reduced / (2 * np.pi))
    np.testing.assert_allclose(pairs.mac, 1.0)
    np.testing.assert_allclose(pairs.error, [0.001, 0.0, 0.002, 0.0], atol=1e-12)
    assert pairs.worst == pytest.approx(0.002)


def test_a_mode_left_out_has_no_pair():
    pairs = pair_frequencies(FULL, FULL[[0, 3]], np.eye(4)[:, [0, 3]], 100.0)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 5.0])
    assert pairs.worst == 0.0


def test_modes_above_the_band_are_left_out():
    pairs = pair_frequencies(FULL, FULL * 1.1, np.eye(4), 2.2)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 2.0])


def test_a_mixed_shape_says_so():
    cross = np.array([[0.8], [0.6]])
    pairs = pair_frequencies(FULL[:2], FULL[:1], cross, 100.0)
    np.testing.assert_allclose(pairs.mac, [0.64])


@pytest.mark.parametrize(("full", "reduced"), [(0, 2), (2, 0)])
def test_nothing_to_pair(full, reduced):
    pairs = pair_frequencies(FULL[:full], FULL[:reduced], np.zeros((full, reduced)), 10.0)
    assert (pairs.error.size, pairs.worst) == (0, 0.0)
