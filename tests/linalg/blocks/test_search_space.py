"""Columns that come by blocks, against one array that holds them all."""

import numpy as np
import pytest

from cmsreduce.linalg.blocks import SearchSpace
from cmsreduce.linalg.machine import SolverSettings, solver_settings
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
        space, first = SearchSpace(N), 0
        for width in widths:
            block = V[:, first : first + width]
            np.testing.assert_array_equal(space.append(block.copy()), block)
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
        # Columns are in a file or in none.
        assert (mapped_in(space.append(W[:, :1])) is None) == (settings.memory == 1e12)


def test_a_space_without_columns_takes_nothing():
    space, W = SearchSpace(N), np.ones((N, 2), order="F")
    assert space.inner(W).shape == (0, 2)
    np.testing.assert_array_equal(space.taken_from(W, np.empty((0, 2))), 1.0)


def test_only_what_outgrows_memory_is_on_disk(tmp_path):
    """A tenth of the memory is a basis of 20 columns, and a search may take three of them."""
    with solver_settings(SolverSettings(memory=8.0 * N * 200, scratch=tmp_path)):
        space = SearchSpace(N)
        on_disk = [mapped_in(space.append(np.full((N, 8), float(i)))) is not None for i in range(10)]
        assert on_disk == [False] * 7 + [True] * 3
        np.testing.assert_array_equal(space.combined(np.eye(80))[0], np.repeat(np.arange(10.0), 8))


def test_the_system_is_asked_for_its_memory_as_columns_double(tmp_path, monkeypatch):
    """To 256 columns by eights: at 8, 24, 56, 120 and 248, each time for twice as many."""
    asked = []
    monkeypatch.setattr("cmsreduce.linalg.machine.settings.available_memory", lambda: asked.append(space.m + 8) or 1e12)
    with solver_settings(SolverSettings(scratch=tmp_path)):
        space = SearchSpace(N)
        for _ in range(32):
            space.append(np.zeros((N, 8)))
    assert asked == [8, 24, 56, 120, 248]
