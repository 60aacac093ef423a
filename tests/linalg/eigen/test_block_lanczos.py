"""Block Lanczos against closed forms: repeated and clustered eigenvalues, restarts, deflation, masses of zero."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen.block_lanczos import BlockLanczos
from cmsreduce.linalg.sparse import ElasticFlexibility, factorise
from tests.linalg.eigen.test_eigenpairs import grid, rod, rod_omega


def unit(n):
    return sp.csc_array(sp.eye_array(n))


def beam(n: int) -> tuple[sp.csc_array, np.ndarray]:
    """Beam on two supports by differences: the square of a string, whose modes are sines."""
    K, lam = grid(n, 1)
    return sp.csc_array(K @ K), lam**2


def plate(n: int) -> tuple[sp.csc_array, np.ndarray]:
    """Square plate on four supports by differences: the square of a membrane; most modes come in pairs."""
    K, lam = grid(n, 2)
    return sp.csc_array(K @ K), lam**2


def largest(lanczos: BlockLanczos, count: int, least: float, steps: int = 400):
    """Run until ``count`` Ritz values of magnitude ``least`` or more have converged; these values and vectors."""
    for _ in range(steps):
        lanczos.step()
        ritz = lanczos.ritz()
        found = int(np.count_nonzero(abs(ritz.theta) >= least))
        if found >= count and (ritz.residual[:found] <= 1e-8 * abs(ritz.theta[:found])).all():
            return ritz.theta[:found], lanczos.vectors(ritz, np.arange(found))
    pytest.fail(f"{found} of {count} after {steps} blocks")


def run(K, M, lam, count, *, sigma=0.0, **options):
    """The ``count`` modes nearest to a shift with all copies of the last, and the exact eigenvalues of the operator."""
    theta = 1 / (lam - sigma)
    theta = theta[np.argsort(-abs(theta), kind="stable")]
    size = abs(theta)
    count = next(k for k in range(count, lam.size) if size[k] < size[k - 1] * (1 - 1e-3))
    solve = factorise(sp.csc_array(K - sigma * M), definite=sigma == 0)
    lanczos = BlockLanczos(
        solve, lambda X: M @ X, K.shape[0], **{"block": 8, "columns": 3 * count + 80, "sought": count} | options
    )
    return *largest(lanczos, count, (size[count - 1] + size[count]) / 2), theta[:count]


BODIES = {
    "rod": (*rod(700), rod_omega(700) ** 2, 30),
    "beam": (beam(150)[0], unit(150), beam(150)[1], 20),
    "plate": (plate(26)[0], unit(676), plate(26)[1], 31),
    "cube": (grid(9, 3)[0], unit(729), grid(9, 3)[1], 29),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("shifted", [False, True], ids=["lowest", "about a shift"])
@pytest.mark.parametrize("block", [7, 16])
def test_closed_forms(name, shifted, block):
    K, M, lam, count = BODIES[name]
    # With a shift between the lowest modes the operator has eigenvalues of either sign.
    at = next(k for k in range(count // 2, count) if lam[k] > lam[k - 1] * 1.01)
    sigma = (lam[at - 1] + lam[at]) / 2 if shifted else 0.0
    theta, X, exact = run(K, M, lam, count, sigma=sigma, block=block)
    np.testing.assert_allclose(np.sort(theta), np.sort(exact), rtol=1e-8 if name == "beam" else 1e-10)
    np.testing.assert_allclose(X.T @ (M @ X), np.eye(theta.size), atol=1e-7)
    R = factorise(sp.csc_array(K - sigma * M), definite=False)(M @ X) - X * theta
    assert (np.sqrt(np.einsum("ij,ij->j", R, M @ R)) <= 2e-8 * abs(theta)).all()


@pytest.mark.parametrize("name", ["rod", "plate"])
def test_a_basis_that_restarts_often_finds_the_same(name):
    K, M, lam, count = BODIES[name]
    # The smallest basis: the vectors that a restart keeps, and three blocks.
    small, X, exact = run(K, M, lam, count, block=4, columns=0)
    large, Y, _ = run(K, M, lam, count, block=4, columns=K.shape[0])
    np.testing.assert_allclose(small, exact, rtol=1e-11)
    np.testing.assert_allclose(small, large, rtol=1e-11)
    angles = la.svdvals(X.T @ (M @ Y))
    np.testing.assert_allclose(angles, 1.0, atol=1e-10)


def test_masses_of_zero():
    """Every second node of a chain has no mass; A M has as many nonzero eigenvalues as there are masses."""
    n = 60
    K, M = rod(2 * n)[0], sp.diags_array(np.tile([0.0, 1.0], n), format="csc")
    lam = 4 * n * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1))) ** 2
    lanczos = BlockLanczos(factorise(K), lambda X: M @ X, 2 * n, block=4, columns=2 * n, sought=n)
    while not lanczos.exhausted:
        lanczos.step()
    np.testing.assert_allclose(lanczos.ritz().theta[:n], 1 / lam, rtol=1e-10)


def test_rigid_modes_are_deflated():
    n = 26
    K, lam = grid(n, 2, free=True)
    M, rigid = unit(n * n), np.full((n * n, 1), 1 / n)
    flexibility = ElasticFlexibility(K, M, rigid)
    lanczos = BlockLanczos(flexibility, lambda X: M @ X, n * n, block=8, columns=150, sought=30, deflated=rigid)
    theta, X = largest(lanczos, 30, 1 / lam[30] * (1 - 1e-9))
    np.testing.assert_allclose(theta, 1 / lam[1 : theta.size + 1], rtol=1e-10)
    assert abs(rigid.T @ X).max() < 1e-12


def test_known_modes_are_not_found_again():
    """With the ten modes above a shift deflated, the next ten are found, also of a repeated mode."""
    K, lam = grid(26, 2)
    values, vectors = la.eigh(K.toarray())
    known = slice(12, 22)
    lanczos = BlockLanczos(
        factorise(sp.csc_array(K - 0.9 * lam[12] * sp.eye_array(676)), definite=False),
        lambda X: X.copy(),
        676,
        block=8,
        columns=150,
        sought=20,
        deflated=vectors[:, known],
    )
    exact = 1 / (np.delete(values, known) - 0.9 * lam[12])
    exact = exact[np.argsort(-abs(exact))]
    theta, X = largest(lanczos, 20, abs(exact[19]) * (1 - 1e-9))
    np.testing.assert_allclose(np.sort(theta), np.sort(exact[: theta.size]), rtol=1e-9)
    assert abs(vectors[:, known].T @ X).max() < 1e-7


def test_a_basis_of_everything_is_exact():
    K, lam = grid(40, 1)
    lanczos = BlockLanczos(factorise(K), lambda X: X.copy(), 40, block=6, columns=40, sought=40)
    while not lanczos.exhausted:
        lanczos.step()
    assert lanczos.m == 40
    np.testing.assert_allclose(lanczos.ritz().theta, 1 / lam, rtol=1e-12)


def test_two_runs_are_identical():
    K, M, lam, count = BODIES["plate"]
    first, second = (run(K, M, lam, count, columns=0) for _ in range(2))
    assert np.array_equal(first[0], second[0])
    assert np.array_equal(first[1], second[1])


def test_a_residual_bounds_the_distance_to_an_eigenvalue():
    """The basis has at most 36 columns, so that restarts are included."""
    K, lam = plate(20)
    lanczos = BlockLanczos(factorise(K), lambda X: X.copy(), 400, block=4, columns=0, sought=16)
    for _ in range(40):
        lanczos.step()
        ritz = lanczos.ritz()
        nearest = abs(ritz.theta[:, None] - 1 / lam[None, :]).min(axis=1)
        assert (nearest <= ritz.residual * (1 + 1e-9) + 1e-11 * ritz.theta[0]).all()
