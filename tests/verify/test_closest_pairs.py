"""Pairs of least distance, against scipy's assignment."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from cmsreduce.verify.transmission_zeros import closest_pairs


@pytest.mark.parametrize("seed", range(40))
def test_pairs_are_as_close_as_scipy_finds_them(seed):
    random = np.random.default_rng(seed)
    a, b = random.integers(1, 40, 2)
    distance = random.random((a, b)) * 10.0 ** random.integers(-8, 8)
    distance[random.random((a, b)) < 0.1 * (seed % 4)] = 0.0
    i, j = closest_pairs(distance)
    assert i.size == j.size == min(a, b) == np.unique(j).size
    assert (np.diff(i) > 0).all()
    least = distance[linear_sum_assignment(distance)].sum()
    assert distance[i, j].sum() <= least + 1e-13 * distance.max()


def test_nothing_pairs_with_nothing():
    assert [part.size for part in closest_pairs(np.empty((0, 3)))] == [0, 0]
