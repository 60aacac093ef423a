"""Eigenpairs of dense pencils: relative accuracy at both ends, massless shapes, rigid modes."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import UndeterminedError, elastic_and_massless, elastic_pairs, refine

NONE = np.empty((3, 0))


def graded(soft: float, stiff: float, coupling: float) -> tuple[np.ndarray, list[float]]:
    """Two dofs of unlike stiffness and their eigenvalues, by the quadratic formula without cancellation."""
    a, c = (2 * np.pi * soft) ** 2, (2 * np.pi * stiff) ** 2
    b = coupling * np.sqrt(a * c)
    high = (a + c) / 2 + np.hypot((c - a) / 2, b)
    return np.array([[a, b], [b, c]]), [a * c * (1 - coupling**2) / high, high]


@pytest.mark.parametrize("coupling", [0.0, 0.3, 0.9])
def test_soft_modes_beside_stiff_ones_keep_their_digits(coupling):
    parts = [graded(1e-4, 1e5, coupling), graded(3e-2, 4e4, coupling), graded(1.0, 2e3, -coupling)]
    K = la.block_diag(*[part for part, _ in parts])
    # Different units of the coordinates change no frequency.
    units = np.array([1.0, 1e-3, 1e4, 1.0, 10.0, 1e2])
    order = np.array([3, 0, 5, 2, 1, 4])
    K, M = (A[np.ix_(order, order)] for A in (K * np.outer(units, units), np.diag(units**2)))
    exact = np.sort(np.concatenate([lam for _, lam in parts]))
    lam, X = elastic_pairs(K, M, np.empty((6, 0)))
    np.testing.assert_allclose(lam, exact, rtol=2e-14 / (1 - coupling**2))
    np.testing.assert_allclose(X.T @ M @ X, np.eye(6), atol=1e-13)


@pytest.mark.parametrize("masses", [(1.0, 1.0), (1e-6, 1e6)], ids=["like masses", "unlike masses"])
@pytest.mark.parametrize("k", [1e-8, 1.0, 1e10])
def test_two_free_masses(masses, k):
    m, n = masses
    K, M = k * np.array([[1.0, -1.0], [-1.0, 1.0]]), np.diag(masses)
    rigid = np.ones((2, 1)) / np.sqrt(m + n)
    lam, X = elastic_pairs(K, M, rigid)
    assert lam.size == 1
    assert lam[0] == pytest.approx(k * (m + n) / (m * n), rel=1e-14)
    assert abs(rigid.T @ M @ X).max() < 1e-14


def test_a_massless_dof_follows_statically():
    k1, k2, m = 300.0, 700.0, 2.0
    K, M = np.array([[k1 + k2, -k2], [-k2, k2]]), np.diag([0.0, m])
    lam, X, N = elastic_and_massless(K, M, NONE[:2])
    assert lam.size == 1
    assert lam[0] == pytest.approx(k1 * k2 / (k1 + k2) / m, rel=1e-14)
    assert X[0, 0] / X[1, 0] == pytest.approx(k2 / (k1 + k2), rel=1e-13)
    # With the mass held, both springs hold the dof.
    np.testing.assert_allclose(N @ N.T, np.diag([1 / (k1 + k2), 0]), atol=1e-18)


@pytest.mark.parametrize("contrast", [1.0, 1e6, 1e12])
def test_massless_shapes_keep_their_flexibility(contrast):
    """A chain from the ground: mass, soft spring, dof, penalty spring, dof. Its end has the compliance of all three."""
    k = np.array([50.0, 3.0, 3.0 * contrast])
    K = np.array([[k[0] + k[1], -k[1], 0], [-k[1], k[1] + k[2], -k[2]], [0, -k[2], k[2]]])
    lam, X, N = elastic_and_massless(K, np.diag([2.0, 0.0, 0.0]), NONE)
    # In doubles a soft shape beside a stiff one has no more digits than these.
    digits = 1e-13 + 1e-15 * contrast
    np.testing.assert_allclose(N.T @ K @ N, np.eye(2), atol=digits)
    np.testing.assert_allclose(X.T @ K @ N, 0, atol=digits)
    np.testing.assert_allclose(lam, [25.0], rtol=digits)
    flexibility = X @ np.diag(1 / lam) @ X.T + N @ N.T
    exact = np.array([1 / 50, 1 / 50 + 1 / 3, 1 / 50 + 1 / 3 + 1 / k[2]])
    np.testing.assert_allclose(flexibility.diagonal(), exact, rtol=digits)


@pytest.mark.parametrize("light", [1e-5, 1e-9, 1e-14])
def test_a_light_mass_is_a_mass(light):
    """Two springs between wall, unit mass and light mass: the product of the squared frequencies is k1 k2 / (m1 m2)."""
    K = np.array([[5.0, -2.0], [-2.0, 2.0]])
    lam, _, N = elastic_and_massless(K, np.diag([1.0, light]), NONE[:2])
    assert N.shape == (2, 0)
    np.testing.assert_allclose([lam.prod(), lam.sum()], [6.0 / light, 5.0 + 2.0 / light], rtol=1e-12)


def test_a_motion_with_neither_mass_nor_stiffness_is_refused():
    """Two massless dofs are joined by a spring and by nothing else."""
    K, M = np.array([[1.0, -1.0, 0], [-1.0, 1.0, 0], [0, 0, 4.0]]), np.diag([0.0, 0.0, 1.0])
    with pytest.raises(UndeterminedError, match="1 motions have neither mass nor stiffness") as refused:
        elastic_pairs(K, M, NONE)
    moved = abs(refused.value.shape)
    np.testing.assert_allclose(moved / moved.max(), [1, 1, 0], atol=1e-12)


def test_a_repeated_shape_has_no_frequency_of_its_own():
    T = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0]])
    K, M = np.diag([4.0, 9.0]), np.eye(2)
    lam, _ = elastic_pairs(T.T @ K @ T + 1e-3 * np.outer([1, 1, -1], [1, 1, -1]), T.T @ M @ T, NONE)
    np.testing.assert_allclose(lam, [4, 9], rtol=1e-12)


def test_repeated_modes_stay_orthonormal():
    Q, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((6, 6)))
    exact = np.array([1.0, 2.0, 2.0, 2.0, 5.0, 5.0])
    K = Q @ np.diag(exact) @ Q.T
    lam, X = elastic_pairs((K + K.T) / 2, np.eye(6), np.empty((6, 0)))
    np.testing.assert_allclose(lam, exact, rtol=1e-14)
    np.testing.assert_allclose(X.T @ X, np.eye(6), atol=1e-14)


def test_refining_squares_the_error():
    rng = np.random.default_rng(5)
    K = np.diag([1.0, 3.0, 7.0, 20.0])
    X = np.eye(4) + 1e-5 * rng.standard_normal((4, 4))
    lam, X = refine(K, np.eye(4), K.diagonal() * (1 + 1e-5), X)
    np.testing.assert_allclose(lam, K.diagonal(), rtol=1e-9)
    assert abs(X - np.diag(X.diagonal())).max() < 1e-8


def test_dependent_vectors_of_one_eigenvalue_are_refused():
    with pytest.raises(MatrixError, match="2 modes near the squared frequency 3 cannot be told apart"):
        refine(np.diag([1.0, 3.0, 3.0]), np.eye(3), np.array([1.0, 3.0, 3.0]), np.eye(3)[:, [0, 1, 1]])


def test_a_mechanism_beyond_the_rigid_modes_is_refused():
    with pytest.raises(MatrixError, match="mechanism"):
        elastic_pairs(np.diag([1.0, 0.0, 2.0]), np.eye(3), NONE)


def test_a_spring_lost_in_the_digits_of_a_file_is_no_wrong_sign():
    """A sloshing mass on 1e-4 N/m beside 1e8 N/m, of which ten digits are written, and a stiffness that pushes."""
    K = np.array([[1e8, -1e8, 0.0], [-1e8, 1e8 + 1e-4, -1e-4], [0.0, -1e-4, 1e-4]])
    printed = K - np.diag([0.0, 3e-3, 0.0])
    rigid = np.ones((3, 1)) / np.sqrt(3)
    with pytest.raises(MatrixError, match=r"5.0e-11.*mechanism, or a spring too soft"):
        elastic_pairs(printed, np.eye(3), rigid, 5e-11)
    with pytest.raises(MatrixError, match="not positive semidefinite"):
        elastic_pairs(np.diag([1.0, -0.1, 2.0]), np.eye(3), NONE)


def test_an_empty_pencil_has_no_modes():
    lam, X = elastic_pairs(np.empty((0, 0)), np.empty((0, 0)), np.empty((0, 0)))
    assert (lam.size, X.shape) == (0, (0, 0))


@pytest.mark.parametrize(("m", "massive"), [(28, 17), (120, 80)])
def test_unit_modes_beside_massless_shapes_are_told_apart(m, massive):
    """Modes of unit mass and static shapes, as in a basis with residual shapes: a large eigenproblem rounds more."""
    w = np.linspace(1.0, 50.0, massive)
    for seed in range(30):
        shapes = np.zeros((m, massive))
        shapes[:massive] = np.eye(massive)
        shapes[massive:] = 1e-60 * np.random.default_rng(seed).standard_normal((m - massive, massive))
        K = np.diag(np.append(w**2, np.ones(m - massive)))
        lam, _, N = elastic_and_massless(K, shapes @ shapes.T, np.empty((m, 0)))
        assert N.shape[1] == m - massive
        np.testing.assert_allclose(np.sqrt(lam), w, rtol=1e-12)


def test_negative_kinetic_energy_shows_the_rounding_of_the_mass():
    """Two masses and four shapes without, in mixed coordinates, with errors of 1e-13 as sums of large terms leave."""
    w = np.array([30.0, 40.0])
    mixed = np.linalg.qr(np.random.default_rng(5).standard_normal((6, 6)))[0]
    M = mixed @ np.diag([1.0, 1.0, -1e-13, 1e-14, 5e-14, 0]) @ mixed.T
    K = mixed @ np.diag([*w**2, 1.0, 2.0, 3.0, 4.0]) @ mixed.T
    lam, _, N = elastic_and_massless(K, M, np.empty((6, 0)))
    assert N.shape[1] == 4
    np.testing.assert_allclose(np.sqrt(lam), w, rtol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_static_shapes_whose_mass_is_rounding_are_massless(seed):
    """Moments on nodes without rotary inertia, of a free plate: their shapes have the square of rounding as mass."""
    rng = np.random.default_rng(seed)
    momentum = la.qr(rng.standard_normal((18, 18)))[0][:, :16]
    momentum[:, 9:14] *= 1e-6
    momentum[:, 14:] = 3e-14 * rng.standard_normal((18, 2))
    K = np.diag([0.0] * 6 + [2e6, 2.6e7, 5.8e7] + [1.0] * 7)
    lam, _, N = elastic_and_massless(K, momentum.T @ momentum, np.eye(16)[:, :6])
    np.testing.assert_allclose(lam, [2e6, 2.6e7, 5.8e7] + [1e12] * 5, rtol=1e-9)
    assert N.shape == (16, 2)


@pytest.mark.parametrize("lever", [1.0, 1e3])
@pytest.mark.parametrize("seed", range(6))
def test_rows_whose_mass_is_what_cancelled_are_massless(seed, lever):
    """Rotations of a knot whose masses cancelled: 2 to 60 roundings of either sign, which no mode may move alone."""
    draw = np.random.default_rng(seed)
    stretch = draw.normal(size=(14, 14))
    K = stretch @ stretch.T + 14 * np.eye(14)
    # A rotation has the units of a lever, in its stiffness and in what is left of its mass.
    size = np.repeat([1.0, lever], [8, 6])
    K *= np.outer(size, size)
    M = np.diag(np.repeat([1.0, 0.0], [8, 6]))
    spread = np.finfo(float).eps * np.trace(M) / np.trace(K)
    noise = spread * draw.uniform(2, 60, 6) * K.diagonal()[8:] * np.array([1, -1, 1, -1, 1, -1])
    M[8:, 8:] = np.diag(noise) + np.diag(noise[1:] / 2, 1) + np.diag(noise[1:] / 2, -1)
    M[:8, 8:] = abs(noise) / 3
    M[8:, :8] = M[:8, 8:].T
    condensed = K[:8, :8] - K[:8, 8:] @ la.solve(K[8:, 8:], K[8:, :8])
    lam, _ = elastic_pairs(K, M, np.empty((14, 0)))
    np.testing.assert_allclose(lam, la.eigvalsh(condensed), rtol=1e-9)


def test_modes_without_mass_are_refused():
    """A frequency that is no number is never handed on: it counted as no mode at all."""
    with pytest.raises(MatrixError, match="a mode has no mass"):
        refine(np.diag([1.0, 9.0]), np.diag([1.0, -1.0]), np.array([1.0, 9.0]), np.eye(2))
