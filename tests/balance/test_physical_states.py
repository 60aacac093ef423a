"""Balanced models in physical coordinates: Moore's example, a chain of masses, and what cannot be balanced."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.balance import choose_coordinates, physical_states
from cmsreduce.errors import DampingError, MatrixError

MOORE = (
    np.array([[0, 0, 0, -150], [1, 0, 0, -245], [0, 1, 0, -113], [0, 0, 1, -19.0]]),
    np.array([[4.0], [1.0], [0.0], [0.0]]),
    np.array([[0.0, 0.0, 0.0, 1.0]]),
)


def transfer(A, B, C, omega):
    return np.array([C @ np.linalg.solve(1j * w * np.eye(len(A)) - A, B) for w in omega])


def largest_error(first, second, omega):
    return max(np.linalg.norm(G, 2) for G in transfer(*first, omega) - transfer(*second, omega))


def chain(masses: int, zeta: float = 0.02):
    """Equal masses between springs, held at one end, pushed at the other: states x, x'."""
    K = 2 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    K[-1, -1] = 1.0
    lam, X = la.eigh(K)
    D = X @ np.diag(2 * zeta * np.sqrt(lam)) @ X.T
    none, one = np.zeros((masses, masses)), np.eye(masses)
    A = np.block([[none, one], [-K, -D]])
    B, C = np.zeros((2 * masses, 1)), np.zeros((1, 2 * masses))
    B[-1], C[0, masses - 1] = 1.0, 1.0
    return A, B, C


def test_moore_to_the_printed_digits():
    found = physical_states(*MOORE, np.eye(4)[[0, 1, 3]])
    np.testing.assert_allclose(found.sigma, [1.593839e-2, 2.724252e-3, 1.272037e-4, 8.005951e-6], rtol=5e-7)
    printed = [[0.090446, -0.289591, -135.897511], [0.875636, 0.398191, -264.391098], [-0.069326, 0.273808, -16.537048]]
    np.testing.assert_allclose(found.A, printed, rtol=0, atol=6e-7)
    assert (abs(found.B.ravel() - [3.997872, 1.002926, 4.73e-5]) <= [6e-7, 6e-7, 6e-8]).all()
    assert found.condition == pytest.approx(466, abs=0.5)


@pytest.mark.parametrize(
    ("kept", "printed", "bound"), [([0, 1, 3], 1.6012e-5, 2 * 8.005951e-6), ([0, 3], 2.4803e-4, 2.7042e-4)]
)
def test_moore_errors(kept, printed, bound):
    omega = np.concatenate([[0.0], np.logspace(-2, 3, 5001)])
    found = physical_states(*MOORE, np.eye(4)[kept])
    error = largest_error(MOORE, (found.A, found.B, found.C), omega)
    assert error == pytest.approx(printed, rel=5e-5)
    assert found.bound == pytest.approx(bound, rel=5e-5)
    assert error <= found.bound * (1 + 1e-9)


@pytest.mark.parametrize("kept", [[0, 1, 2], [1, 2, 3], [0, 2, 3]])
def test_whatever_states_are_chosen_the_answer_is_that_of_the_balanced_model(kept):
    omega = np.logspace(-2, 3, 200)
    one, other = (physical_states(*MOORE, np.eye(4)[rows]) for rows in ([0, 1, 3], kept))
    assert largest_error((one.A, one.B, one.C), (other.A, other.B, other.C), omega) < 1e-12


def test_all_states_kept_is_the_model_itself():
    A, B, C = chain(3)
    found = physical_states(A, B, C, np.eye(6))
    np.testing.assert_allclose(found.A, A, atol=1e-9)
    np.testing.assert_allclose(found.B, B, atol=1e-9)
    np.testing.assert_allclose(found.C, C, atol=1e-9)
    assert found.bound == 0.0


@pytest.mark.parametrize("states", [4, 6, 8])
def test_chosen_masses_keep_displacement_and_rate(states):
    n = 8
    A, B, C = chain(n)
    moves, rates = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    chosen = choose_coordinates(A, B, C, moves, rates, states)
    assert np.unique(chosen).size == states // 2
    found = physical_states(A, B, C, np.vstack([moves[chosen], rates[chosen]]))
    omega = np.linspace(0.01, 3, 400)
    assert largest_error((A, B, C), (found.A, found.B, found.C), omega) <= found.bound * (1 + 1e-9)
    # Any other choice of as many masses is conditioned much the same or worse.
    worst = physical_states(A, B, C, np.vstack([moves[: states // 2], rates[: states // 2]])).condition
    assert found.condition < 2 * worst


def test_the_choice_does_not_depend_on_units():
    n = 6
    A, B, C = chain(n)
    moves, rates = np.eye(2 * n)[:n], np.eye(2 * n)[n:]
    unit = np.array([1, 1e3, 1, 57.3, 1, 1e-6])[:, None]
    one, other = (choose_coordinates(A, B, C, k * moves, k * rates, 6) for k in (1.0, unit))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("model", "rows", "kind", "words"),
    [
        (chain(2, zeta=0.0), np.eye(4)[:2], DampingError, "rigid motions"),
        (MOORE, np.zeros((2, 4)), MatrixError, "depend on one another"),
        (MOORE, np.eye(4)[[0, 0]], MatrixError, "depend on one another"),
        ((-np.eye(2), np.eye(2)[:, :1], np.eye(2)[:1]), np.eye(2), MatrixError, "only 1 of the model's 2 states"),
    ],
)
def test_what_cannot_be_balanced_says_so(model, rows, kind, words):
    with pytest.raises(kind, match=words):
        physical_states(*model, rows)


@pytest.mark.parametrize(("states", "words"), [(3, "even number"), (6, "only 2 of the 2 on offer")])
def test_coordinates_that_cannot_be_chosen(states, words):
    A, B, C = chain(4)
    with pytest.raises(MatrixError, match=words):
        choose_coordinates(A, B, C, np.eye(8)[:2], np.eye(8)[4:6], states)
