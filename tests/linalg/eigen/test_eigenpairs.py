"""Modes below a cutoff against closed forms of rods, beams, membranes; none missed, no repeated mode split."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import certified_modes, count_below, modes_below, rigid_body_modes
from cmsreduce.linalg.eigen.spectrum_slicing import shifted_factor, sturm_count
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import ElasticFlexibility
from cmsreduce.model import rigid_body_shapes
from tests.frames import BAR, frame, line


def rod(n: int) -> tuple[sp.csc_array, sp.csc_array]:
    """Fixed-free rod of n linear elements, consistent mass; EA = rho A = L = 1."""
    h = 1 / n
    K = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tolil() / h
    M = sp.diags_array([1.0, 4.0, 1.0], offsets=[-1, 0, 1], shape=(n, n)).tolil() * (h / 6)
    K[n - 1, n - 1], M[n - 1, n - 1] = 1 / h, h / 3
    return sp.csc_array(K), sp.csc_array(M)


def rod_omega(n: int) -> np.ndarray:
    """Exact frequencies of the discrete rod."""
    c = np.cos((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * n))
    return np.sort(np.sqrt(6 * n**2 * (1 - c) / (2 + c)))


def path(n: int, *, free: bool) -> sp.csr_array:
    L = sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tolil()
    if free:
        L[0, 0] = L[n - 1, n - 1] = 1.0
    return sp.csr_array(L)


def grid(n: int, dimensions: int, *, free: bool = False) -> tuple[sp.csc_array, np.ndarray]:
    """Square membrane (or cube) of point masses and springs, and its squared frequencies."""
    L, K = path(n, free=free), sp.csr_array((1, 1))
    for _ in range(dimensions):
        K = sp.kronsum(L, K, format="csr")
    index = np.arange(n) if free else np.arange(1, n + 1)
    lam = 4 * np.sin(np.pi * index / (2 * (n if free else n + 1))) ** 2
    total = np.zeros(1)
    for _ in range(dimensions):
        total = np.add.outer(total, lam).ravel()
    return sp.csc_array(K), np.sort(total)


def assert_modes(K, M, w, Phi):
    np.testing.assert_allclose(Phi.T @ (M @ Phi), np.eye(w.size), atol=1e-9)
    np.testing.assert_allclose(Phi.T @ (K @ Phi), np.diag(w**2), atol=1e-9 * max(w.max(initial=0.0) ** 2, 1e-300))
    assert (Phi[abs(Phi).argmax(axis=0), np.arange(w.size)] > 0).all()


@pytest.mark.parametrize("n", [40, 900], ids=["dense", "Lanczos"])
@pytest.mark.parametrize("count", [0, 1, 12, 31])
def test_rod(n, count):
    K, M = rod(n)
    exact = rod_omega(n)
    cutoff = exact[0] / 2 if count == 0 else (exact[count - 1] + exact[count]) / 2
    w, Phi = modes_below(K, M, cutoff)
    np.testing.assert_allclose(w, exact[:count], rtol=1e-9)
    assert_modes(K, M, w, Phi)
    assert sturm_count(K, M, cutoff) == count


def test_cantilever():
    body = line("cantilever", [0, 0, 0], [2, 0, 0], 30, held=(1,))
    s, L = BAR, 2.0
    beta = np.array([1.87510406871196, 4.69409113297418, 7.85475743823761, 10.9955407348755])
    bending = [(beta / L) ** 2 * np.sqrt(s.E * moment / (s.rho * s.A)) for moment in (s.Iy, s.Iz)]
    odd = np.array([1, 3, 5]) * np.pi / (2 * L)
    torsion = odd * np.sqrt(s.G * s.J / (s.rho * (s.Iy + s.Iz)))
    axial = odd * np.sqrt(s.E / s.rho)
    exact = np.sort(np.concatenate([*bending, torsion, axial]))
    w, _ = modes_below(body.K, body.M, 1000.0)
    exact = exact[exact < 1000.0]
    assert w.size == exact.size == 7
    np.testing.assert_allclose(w, exact, rtol=2e-5)


@pytest.mark.parametrize("dimensions, n", [(2, 26), (3, 9)], ids=["membrane 26 x 26", "cube 9 x 9 x 9"])
@pytest.mark.parametrize("nudge", [0.0, -1e-11, 1e-11], ids=["at", "just below", "just above"])
@pytest.mark.parametrize("at", [1, 5, 20])
def test_a_cutoff_at_a_repeated_mode_keeps_all_of_it(dimensions, n, nudge, at):
    K, lam = grid(n, dimensions)
    M = sp.csc_array(sp.eye_array(K.shape[0]))
    expected = lam[lam <= lam[at] * (1 + 1e-8)]
    # The second mode is a pair in the membrane and a triple in the cube; higher modes are up to sixfold.
    w, Phi = modes_below(K, M, np.sqrt(lam[at]) * (1 + nudge))
    np.testing.assert_allclose(w**2, expected, rtol=1e-10)
    assert_modes(K, M, w, Phi)


@pytest.mark.parametrize("n", [12, 26], ids=["dense", "Lanczos"])
def test_free_membrane_without_its_rigid_mode(n):
    K, lam = grid(n, 2, free=True)
    M = sp.csc_array(0.5 * sp.eye_array(n * n))
    rigid = np.full((n * n, 1), np.sqrt(2) / n)
    cutoff = np.sqrt(2 * lam[30]) * 1.0001
    w, Phi = modes_below(K, M, cutoff, rigid=rigid)
    np.testing.assert_allclose(w**2, 2 * lam[1 : w.size + 1], rtol=1e-9)
    assert w.size == np.count_nonzero(2 * lam <= cutoff**2) - 1
    assert abs(rigid.T @ (M @ Phi)).max() < 1e-11


@pytest.mark.parametrize("n", [60, 700], ids=["dense", "Lanczos"])
def test_massless_nodes_follow_statically(n):
    """Every second node of a chain has no mass: springs in pairs, half as stiff, between the others."""
    K, _ = rod(2 * n)
    M = sp.diags_array(np.tile([0.0, 1.0], n), format="csc")
    # Fixed-free chain of n unit masses and springs n: w = 2 sqrt(k) sin((2 i - 1) pi / (2 (2 n + 1))).
    exact = 2 * np.sqrt(n) * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1)))
    w, Phi = modes_below(K, M, (exact[9] + exact[10]) / 2)
    np.testing.assert_allclose(w, exact[:10], rtol=1e-9)
    assert_modes(K, M, w, Phi)
    assert w.size == 10


def test_no_cutoff_no_modes():
    for n in (20, 700):
        w, Phi = modes_below(*rod(n), 0.0)
        assert (w.size, Phi.shape) == (0, (n, 0))


@pytest.mark.parametrize("seed", range(5))
def test_sturm_count_is_the_dense_count(seed):
    rng = np.random.default_rng(seed)
    n = 60
    C = sp.random_array((n, n), density=0.05, rng=rng)
    K = sp.csc_array(C @ C.T + 0.1 * sp.eye_array(n))
    M = sp.diags_array(rng.uniform(0.1, 5.0, n), format="csc")
    w = np.sqrt(la.eigvalsh(K.toarray(), M.toarray()))
    for omega in [0.5 * w[0], *(w[:-1:7] + w[1::7]) / 2, 2 * w[-1]]:
        assert sturm_count(K, M, omega) == np.count_nonzero(w < omega)


def test_a_count_at_an_eigenvalue_includes_it():
    K, M = sp.diags_array([1.0, 4.0, 4.0, 9.0], format="csc"), sp.csc_array(sp.eye_array(4))
    assert [sturm_count(K, M, w) for w in (0.5, 1.0, 2.0, 3.0)] == [0, 1, 3, 4]


def spatial_frame(name="frame", **options):
    xyz = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8]]
    bars = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5)]
    return frame(name, xyz, bars, **options)


def test_elastic_flexibility_is_the_sum_over_elastic_modes():
    body = spatial_frame()
    R = rigid_body_shapes(body.dofs, body.nodes)
    rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
    flexibility = ElasticFlexibility(body.K, body.M, rigid)
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    exact = X[:, 6:] @ np.diag(1 / lam[6:]) @ X[:, 6:].T
    F = flexibility(np.eye(body.n))
    np.testing.assert_allclose(F, exact, atol=1e-9 * abs(exact).max())
    np.testing.assert_allclose(F, F.T, atol=1e-9 * abs(exact).max())
    # Statically, K times the displacement is the self-balanced load.
    load = body.K @ np.random.default_rng(0).standard_normal(body.n)
    np.testing.assert_allclose(body.K @ flexibility(load), load, atol=1e-9 * abs(load).max())
    np.testing.assert_allclose(flexibility(body.M @ rigid), 0, atol=1e-9 * abs(exact).max())


def test_a_mechanism_is_refused():
    K, lam = grid(5, 2, free=True)
    assert lam[0] == pytest.approx(0.0)
    with pytest.raises(MatrixError, match="mechanism"):
        modes_below(sp.block_diag([K, sp.csc_array((1, 1))], format="csc"), sp.csc_array(sp.eye_array(26)), 1.0)


def clustered(seed: int, n: int = 640) -> tuple[sp.csc_array, sp.csc_array, np.ndarray]:
    """Random pencil with known modes: groups of equal blocks with small random differences.

    Returns stiffness, mass and squared frequencies, ascending.
    """
    rng = np.random.default_rng(seed)
    blocks, masses = [], []
    while 8 * len(blocks) < n:
        C, D = rng.standard_normal((2, 8, 8))
        stiffness, mass = C @ C.T + 0.3 * np.eye(8), D @ D.T + 4 * np.eye(8)
        for _ in range(min(int(rng.integers(1, 30)), n // 8 - len(blocks))):
            blocks.append(stiffness * (1 + rng.choice([0.0, 1e-12, 1e-8, 1e-4]) * rng.standard_normal()))
            masses.append(mass)
    lam = np.concatenate([la.eigvalsh(k, m) for k, m in zip(blocks, masses, strict=True)])
    order = rng.permutation(n)
    K, M = (sp.csc_array(sp.block_diag(parts, format="csc")[order][:, order]) for parts in (blocks, masses))
    return K, M, np.sort(lam)


@pytest.mark.parametrize("backend", ["superlu", pytest.param("pardiso", marks=pytest.mark.pardiso)])
@pytest.mark.parametrize("seed", range(4))
def test_as_many_clustered_modes_as_were_counted(seed, backend):
    K, M, lam = clustered(seed)
    w = np.sqrt(lam)
    for at in (3, 40, 90):
        at = next(k for k in range(at, w.size) if w[k] > w[k - 1] * (1 + 1e-5))
        cutoff = (w[at - 1] + w[at]) / 2
        with solver_settings(SolverSettings(backend)):
            assert count_below(K, M, cutoff) == at
            modes = certified_modes(K, M, cutoff, count=at)
        assert modes.omega.size == at
        assert_modes(K, M, modes.omega, modes.Phi)
        assert (abs(modes.omega / w[:at] - 1) <= modes.bound + 1e-12).all()
        assert modes.bound.max() < 1e-7


@pytest.mark.parametrize("n", [300, 900], ids=["dense", "Lanczos"])
def test_a_bound_is_never_exceeded(n):
    K, M = rod(n)
    exact = rod_omega(n)
    modes = certified_modes(K, M, (exact[39] + exact[40]) / 2)
    assert modes.omega.size == 40
    assert (abs(modes.omega / exact[:40] - 1) <= modes.bound + 1e-10).all()
    assert (modes.bound >= 0).all()
    assert modes.bound.max() < 2e-8


def test_a_count_that_is_too_high_is_refused():
    K, M = rod(700)
    w = rod_omega(700)
    with pytest.raises(MatrixError, match=r"21 modes lie below .* but 20 were found"):
        certified_modes(K, M, (w[19] + w[20]) / 2, count=21)


def test_two_runs_give_the_same_digits():
    K, lam = grid(26, 2)
    M = sp.csc_array(sp.eye_array(676))
    first, second = (certified_modes(K, M, np.sqrt(lam[60])) for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert np.array_equal(a, b)


def test_a_shift_at_an_eigenvalue_is_raised():
    K, M = sp.diags_array([1.0, 4.0, 4.0, 9.0], format="csc"), sp.csc_array(sp.eye_array(4))
    sigma, factor = shifted_factor(K, M, 4.0)
    assert 4.0 < sigma < 4.0 * (1 + 1e-6)
    assert factor.negative_pivots == 3
