"""Columns that are added by blocks, compared with one array of all columns."""

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
def test_products_equal_those_of_one_array(settings, widths):
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
        # New columns follow the remaining ones.
        space.append(np.asfortranarray(W))
        np.testing.assert_array_equal(space.combined(np.eye(75))[:, 70:], W)
        # New columns are in a file, or in memory.
        assert (mapped_in(space.append(W[:, :1])) is None) == (settings.memory == 1e12)


def test_a_space_without_columns_changes_nothing():
    space, W = SearchSpace(N), np.ones((N, 2), order="F")
    assert space.inner(W).shape == (0, 2)
    np.testing.assert_array_equal(space.taken_from(W, np.empty((0, 2))), 1.0)


def test_only_blocks_that_outgrow_memory_are_on_disk(tmp_path):
    """A tenth of the memory holds a basis of 20 columns, and a search may take three bases."""
    with solver_settings(SolverSettings(memory=8.0 * N * 200, scratch=tmp_path)):
        space = SearchSpace(N)
        on_disk = [mapped_in(space.append(np.full((N, 8), float(i)))) is not None for i in range(10)]
        assert on_disk == [False] * 7 + [True] * 3
        np.testing.assert_array_equal(space.combined(np.eye(80))[0], np.repeat(np.arange(10.0), 8))


def test_free_memory_is_read_only_when_columns_double(tmp_path, monkeypatch):
    """256 columns, eight at a time: memory is read at 8, 24, 56, 120 and 248, for twice as many columns."""
    asked = []
    monkeypatch.setattr("cmsreduce.linalg.machine.settings.available_memory", lambda: asked.append(space.m + 8) or 1e12)
    with solver_settings(SolverSettings(scratch=tmp_path)):
        space = SearchSpace(N)
        for _ in range(32):
            space.append(np.zeros((N, 8)))
    assert asked == [8, 24, 56, 120, 248]
