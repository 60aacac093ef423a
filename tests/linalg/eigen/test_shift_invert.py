"""Modes about a shift against closed forms: more copies than a block has columns, and windows that end early."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.eigen.shift_invert import Window, modes_about
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import factorise
from tests.linalg.eigen.test_eigenpairs import grid, rod, rod_omega


def copies(number: int, weak: float) -> tuple[sp.csc_array, np.ndarray]:
    """Equal strings side by side, tied to their neighbours by springs of stiffness ``weak``; squared frequencies."""
    K, lam = grid(25, 1)
    ties, tied = grid(number, 1)
    K = sp.kron(sp.eye_array(number), K) + weak * sp.kron(ties, sp.eye_array(25))
    return sp.csc_array(K), np.sort(np.add.outer(lam, weak * tied).ravel())


def about(K, M, lam, sigma, low, high, enough, deflated=None):
    counts = [int(np.count_nonzero((lam > a) & (lam <= b))) for a, b in ((low, sigma), (sigma, high))]
    window = Window(sigma, low, high, *counts, min(enough, sum(counts)))
    solve = factorise(sp.csc_array(K - sigma * M), definite=sigma == 0)
    none = np.empty((K.shape[0], 0)) if deflated is None else deflated
    return modes_about(window, solve, lambda X: M @ X, none)


@pytest.mark.parametrize("weak", [0.0, 1e-9, 1e-5], ids=["unconnected", "weakly tied", "loosely tied"])
@pytest.mark.parametrize("sigma", [0.0, 0.035], ids=["lowest", "between the first groups"])
@pytest.mark.parametrize(
    ("number", "backend"), [(60, "superlu"), pytest.param(40, "pardiso", marks=pytest.mark.pardiso)]
)
def test_more_copies_than_a_block_has_columns(number, weak, sigma, backend):
    K, lam = copies(number, weak)
    M = sp.csc_array(sp.eye_array(lam.size))
    expected = lam[: 2 * number]
    with solver_settings(SolverSettings(backend)):
        modes = about(K, M, lam, sigma, 0.0, (lam[2 * number - 1] + lam[2 * number]) / 2, 10**6)
    np.testing.assert_allclose(modes.lam, expected, rtol=1e-11)
    np.testing.assert_allclose(modes.X.T @ modes.X, np.eye(expected.size), atol=1e-11)
    assert (abs(modes.lam / expected - 1) / 2 <= modes.bound + 1e-13).all()
    assert np.linalg.norm(K @ modes.X - modes.X * modes.lam, axis=0).max() < 1e-9


@pytest.mark.parametrize("enough", [5, 20, 100])
def test_all_modes_below_the_shift_and_some_above(enough):
    K, M = rod(700)
    lam = rod_omega(700) ** 2
    sigma = (lam[29] + lam[30]) / 2
    modes = about(K, M, lam, sigma, (lam[9] + lam[10]) / 2, (lam[99] + lam[100]) / 2, enough)
    assert modes.complete
    assert modes.lam.size >= min(max(enough, 20), 90)
    np.testing.assert_allclose(modes.lam, lam[10 : 10 + modes.lam.size], rtol=1e-9)


def test_a_shift_at_an_eigenvalue_gives_no_modes():
    K, M = rod(700)
    lam = rod_omega(700) ** 2
    assert about(K, M, lam, lam[30] * (1 + 1e-8), lam[20], lam[40], 20) is None


def test_a_count_that_is_too_high_is_not_met():
    K, M = rod(100)
    lam = rod_omega(100) ** 2
    window = Window(0.0, 0.0, (lam[9] + lam[10]) / 2, 0, 11, 11)
    modes = modes_about(window, factorise(K), lambda X: M @ X, np.empty((100, 0)))
    assert not modes.complete
    np.testing.assert_allclose(modes.lam, lam[:10], rtol=1e-9)
