"""Square-root factors, Hankel values from them, and balanced states."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.gramian import balancing, hankel_norm, hankel_singular_values, semidefinite_root
from tests.lyapunov import dense_states, gramians, hankel, mixed, response, two_close_modes


@pytest.mark.parametrize("rank", [0, 1, 4, 9])
def test_a_factor_has_the_rank_of_the_matrix(rank):
    L = np.random.default_rng(0).standard_normal((9, rank)) * np.logspace(0, -5, 9)[:, None]
    found = semidefinite_root(L @ L.T)
    assert found.shape == (9, rank)
    # Rounding is relative to the size of the row and column of an entry.
    size = np.sqrt(np.outer((L**2).sum(axis=1), (L**2).sum(axis=1)))
    assert (abs(found @ found.T - L @ L.T) <= 1e-14 * size).all()


def test_weak_states_keep_their_digits_beside_strong_ones():
    """Two uncoupled pairs with a ratio of 1e24 in the Gramian: the weak pair is not rounding."""
    pair = np.array([[2.0, 1.0], [1.0, 2.0]])
    W = la.block_diag(pair, 1e-24 * pair)
    L = semidefinite_root(W)
    assert L.shape == (4, 4)
    np.testing.assert_allclose(hankel_singular_values(L, L)[2:], [3e-24, 1e-24], rtol=1e-6, atol=1e-30)


@pytest.mark.parametrize("seed", range(3))
def test_values_are_those_of_the_product_of_gramians(seed):
    ch = mixed(seed)
    W, V = gramians(ch)
    sigma = hankel_singular_values(semidefinite_root(W), semidefinite_root(V))
    np.testing.assert_allclose(sigma**2, np.sort(la.eigvals(W @ V).real)[::-1], rtol=1e-8)
    assert hankel_norm(semidefinite_root(W), semidefinite_root(V)) == pytest.approx(sigma[0], rel=1e-12)


def test_the_norm_of_a_large_model():
    """440 states, above the size up to which all singular values are computed."""
    rng = np.random.default_rng(4)
    n = 440
    root = np.diag(rng.uniform(1, 2, n)) + 1e-3 * rng.standard_normal((n, n))
    W, V = root @ root.T, root.T @ root
    expected = la.svdvals(la.cholesky(V, lower=True).T @ la.cholesky(W, lower=True))[0]
    assert hankel_norm(semidefinite_root(W), semidefinite_root(V)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("ch", [mixed(0), mixed(1, zeta=0.4), two_close_modes(0.001, (1, -0.9))], ids=lambda c: c.body)
def test_both_transformed_gramians_are_the_hankel_values(ch):
    W, V = gramians(ch)
    found = balancing(semidefinite_root(W), semidefinite_root(V))
    scale = found.sigma[0]
    np.testing.assert_allclose(found.left.T @ found.right, np.eye(found.sigma.size), atol=1e-11)
    np.testing.assert_allclose(found.left.T @ W @ found.left, np.diag(found.sigma), atol=1e-12 * scale)
    np.testing.assert_allclose(found.right.T @ V @ found.right, np.diag(found.sigma), atol=1e-12 * scale)
    np.testing.assert_allclose(found.sigma, hankel(ch)[: found.sigma.size], rtol=1e-6)


def worst(ch, states: int) -> tuple[float, float]:
    """Largest response of a single channel, and largest error of its balanced model of ``states`` states."""
    W, V = gramians(ch)
    found, (A, B, C) = balancing(semidefinite_root(W), semidefinite_root(V)), dense_states(ch)
    left, right = found.left[:, :states], found.right[:, :states]
    A, B, C = left.T @ A @ right, left.T @ B, C @ right
    w = np.unique(np.concatenate([np.linspace(0.9, 1.1, 40001), ch.omega[1] + np.linspace(-0.02, 0.02, 40001)]))
    H = response(ch, w)[:, 0, 0]
    poles, X = la.eig(A)
    H_r = (1 / (1j * w[:, None] - poles)) @ ((C @ X)[0] * la.solve(X, B)[:, 0])
    return abs(H).max(), abs(H - H_r).max()


@pytest.mark.parametrize(
    ("apart", "c", "size", "error", "bound"),
    [
        (0.001, (1, 0.9), 188.04, 0.472, 0.2359 * 4),
        (0.001, (1, -0.9), 22.21, 3.574, 2 * (1.801 + 1.773)),
        (0.01, (1, 0.9), 123.91, 34.17, 2 * (17.10 + 17.09)),
        (0.5, (1, 0.9), 100.01, 59.99, 2 * (29.99 + 29.98)),
    ],
)
def test_balanced_truncation_of_a_cluster(apart, c, size, error, bound):
    """H-infinity errors of one mode, two states, as in theory section 4."""
    found = worst(two_close_modes(apart, c), 2)
    assert found[0] == pytest.approx(size, abs=0.005)
    assert found[1] == pytest.approx(error, rel=2e-3 if error < 1 else 2e-4)
    assert found[1] <= bound


def test_unexcited_states_have_no_balanced_states():
    none = balancing(np.zeros((4, 0)), np.eye(4))
    assert none.sigma.size == 0 and none.right.shape == (4, 0)
    np.testing.assert_array_equal(hankel_singular_values(np.zeros((4, 0)), np.eye(4)), np.zeros(4))
    assert hankel_norm(np.zeros((4, 0)), np.eye(4)) == 0.0
