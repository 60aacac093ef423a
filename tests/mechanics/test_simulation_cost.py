"""Cost of a simulation: operations counted by hand, and steps that keep their accuracy in a simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import highest_frequency
from cmsreduce.mechanics import cost, step_operations
from cmsreduce.model import Configuration, System

BAND = 10.0


def system(M: np.ndarray, K: np.ndarray, D: np.ndarray | None = None) -> System:
    n = len(M)
    none = np.zeros((n, 0))
    return System(Configuration("as built"), np.eye(n), M, K, D, None, none, none.T, none.T, none, {"body": n}, (), ())


def modes(omega: np.ndarray, zeta: float = 0.01) -> System:
    return system(np.eye(omega.size), np.diag(omega**2), np.diag(2 * zeta * omega))


def test_uncoupled_modes_take_operations_in_proportion_to_their_number() -> None:
    """Stiffness and damping 2 n each, mass n (theory section 12)."""
    for n in (1, 7, 40):
        found = modes(np.linspace(1.0, 9.0, n))
        assert step_operations(found, "central_difference") == 5 * n
        assert step_operations(found, "rk4") == 4 * 5 * n
        # An implicit step multiplies with the mass, too: 2 n more.
        assert step_operations(found, "trapezoidal") == 7 * n


def test_full_matrices_take_operations_in_proportion_to_the_square() -> None:
    n = 12
    A = np.full((n, n), 0.1) + np.eye(n)
    # Two products of 2 n^2, and both triangles of the factor: 2 n (n + 1).
    assert step_operations(system(A, A, A), "modified_euler") == 4 * n**2 + 2 * n * (n + 1)
    assert step_operations(system(A, A), "modified_euler") == 2 * n**2 + 2 * n * (n + 1)


def test_a_mode_of_twice_the_frequency_takes_twice_the_steps() -> None:
    low, high = (cost(modes(np.array([5.0, top])), top, BAND) for top in (100.0, 200.0))
    assert high.operations == pytest.approx(2 * low.operations, rel=1e-12)
    # Without that mode a reduced model trades it for longer steps.
    fewer = cost(modes(np.array([5.0])), 5.0, BAND)
    assert low.operations / fewer.operations == pytest.approx(2 * 100 / 5, rel=1e-12)


def test_implicit_steps_follow_the_band() -> None:
    found = [cost(modes(np.array([5.0, top])), top, BAND, "trapezoidal") for top in (1e3, 1e5)]
    assert found[0].steps == found[1].steps
    assert found[0].steps["1_percent"] == pytest.approx(0.346 / (2 * np.pi * BAND), rel=0.02)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
def test_the_step_keeps_the_accuracy_in_a_simulation(accuracy: float) -> None:
    """Central differences on a lone oscillator over many periods, its frequency by the phase."""
    omega = 30.0
    h = 1 / cost(modes(np.array([omega]), 0.0), omega, BAND, accuracy=accuracy).steps_per_second
    steps = 4000
    x = np.empty(steps)
    x[0], x[1] = 1.0, 1 - (omega * h) ** 2 / 2
    for k in range(1, steps - 1):
        x[k + 1] = 2 * x[k] - x[k - 1] - (omega * h) ** 2 * x[k]
    crossings = np.flatnonzero(np.diff(np.sign(x)))
    at = crossings + x[crossings] / (x[crossings] - x[crossings + 1])
    found = np.pi * (at.size - 1) / ((at[-1] - at[0]) * h)
    assert abs(found / omega - 1) == pytest.approx(accuracy, rel=0.02)


def chain(n: int, massless: int) -> tuple[sp.csc_array, sp.csc_array]:
    chance = np.random.default_rng(n)
    k, m = chance.uniform(1, 2, n + 1), chance.uniform(1, 2, n)
    m[chance.permutation(n)[:massless]] = 0.0
    K = sp.diags_array([k[:-1] + k[1:], -k[1:-1], -k[1:-1]], offsets=[0, 1, -1])
    return sp.csc_array(K), sp.csc_array(sp.diags_array(m))


@pytest.mark.parametrize(("n", "massless"), [(40, 0), (40, 9), (700, 0), (700, 150)])
def test_highest_frequency_of_sparse_matrices(n: int, massless: int) -> None:
    """Massless dofs are condensed; the inverse pencil has their eigenvalues at zero."""
    K, M = chain(n, massless)
    found = highest_frequency(K, M)
    assert found is not None
    flexibility = la.eigh(M.toarray(), K.toarray(), eigvals_only=True)
    assert found.omega**2 == pytest.approx(1 / flexibility[massless], rel=1e-5)
    assert found.factor_entries == n - massless


def test_no_highest_frequency_where_a_motion_has_no_mass() -> None:
    """A rod of two dofs whose mass is at its centre: its turning has stiffness and no mass."""
    K, M = sp.csc_array(np.eye(2)), sp.csc_array(np.full((2, 2), 0.25))
    assert highest_frequency(K, M) is None


def test_cost_does_not_change_the_system() -> None:
    found = modes(np.array([3.0, 4.0]))
    before = replace(found, K=found.K.copy(), M=found.M.copy())
    cost(found, 4.0, BAND)
    assert np.array_equal(before.K, found.K) and np.array_equal(before.M, found.M)
