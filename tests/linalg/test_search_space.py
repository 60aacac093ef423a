"""Columns that come by blocks, against one array that holds them all."""

import numpy as np
import pytest

from cmsreduce.linalg.search_space import SearchSpace
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings
from cmsreduce.model import mapped_in

N = 500


@pytest.fixture(params=["in memory", "on disk"])
def settings(request, tmp_path) -> SolverSettings:
    # A search may take three bases, and a basis a tenth of the memory.
    memory = 1e12 if request.param == "in memory" else 8.0 * N
    return SolverSettings(memory=memory, scratch=tmp_path)


@pytest.mark.parametrize("widths", [(16,) * 9, (30, 30, 7, 60, 1), (130,)])
def test_products_are_those_of_the_columns(settings, widths):
    random = np.random.default_rng(0)
    V = random.standard_normal((N, sum(widths)))
    W, c, S = random.standard_normal((N, 5)), random.standard_normal((V.shape[1], 5)), np.eye(V.shape[1])[:, ::-1]
    with solver_settings(settings):
        space, first = SearchSpace(N, 200), 0
        for width in widths:
            block = V[:, first : first + width]
            np.testing.assert_array_equal(space.append(np.asfortranarray(block)), block)
            first += width
        assert space.m == V.shape[1]
        np.testing.assert_allclose(space.inner(W), V.T @ W, atol=1e-12)
        taken = np.asfortranarray(W)
        assert space.taken_from(taken, c) is not W
        np.testing.assert_allclose(taken, W - V @ c, atol=1e-11)
        np.testing.assert_allclose(space.combined(c), V @ c, atol=1e-11)
        space.shrink(S[:, :70])
        assert space.m == 70
        np.testing.assert_allclose(space.combined(np.eye(70)), V @ S[:, :70], atol=1e-12)
        # What is added now follows what is left.
        space.append(np.asfortranarray(W))
        np.testing.assert_array_equal(space.combined(np.eye(75))[:, 70:], W)
        # The newest columns, which lie together, are views of the file or of none.
        assert (mapped_in(space.append(W[:, :1])) is None) == (settings.memory == 1e12)


def test_a_space_without_columns_takes_nothing():
    space, W = SearchSpace(N, 10), np.ones((N, 2), order="F")
    assert space.inner(W).shape == (0, 2)
    np.testing.assert_array_equal(space.taken_from(W, np.empty((0, 2))), 1.0)
