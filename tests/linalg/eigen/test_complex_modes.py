"""Complex modes against characteristic equations, with dense and with sparse matrices."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import ComplexModes, DampedPencil, complex_modes, elastic_pairs, modes_below

# The face of the room has a function of the same name.
module = import_module("cmsreduce.linalg.eigen.complex_modes")
ALL = 1e6  # rad/s


def chain(k: np.ndarray, held: bool = False) -> np.ndarray:
    """Springs one after the other; ``held`` puts the first mass on one more of the first stiffness."""
    K = np.zeros((k.size + 1, k.size + 1))
    for i, value in enumerate(k):
        K[i : i + 2, i : i + 2] += value * np.array([[1, -1], [-1, 1]])
    K[0, 0] += k[0] * held
    return K


def dampers(n: int, **c: float) -> np.ndarray:
    """``d3=2.0`` is a damper between mass 3 and the ground."""
    D = np.zeros((n, n))
    for name, value in c.items():
        D[int(name[1:]), int(name[1:])] = value
    return D


def found(K, M, D=None, loss=None, rigid=None, top=ALL) -> ComplexModes:
    K, M = np.asarray(K, dtype=float), np.asarray(M, dtype=float)
    return complex_modes(DampedPencil(K, M, D, loss), top, np.empty((len(K), 0)) if rigid is None else rigid)


def by_search(K, M, D, loss, rigid, top) -> ComplexModes:
    """Modes of sparse matrices by the search for large systems."""
    K, M, D, loss = (None if A is None else sp.csc_array(A) for A in (K, M, D, loss))
    undamped = modes_below(K, M, 1.14 * top, rigid=rigid)
    return complex_modes(DampedPencil(K, M, D, loss), top, rigid, undamped)


@pytest.mark.parametrize("c", [0.1, 1.0, 3.0])
def test_two_masses_and_one_damper(c: float) -> None:
    """Det of [[s^2 + c s + 2, -1], [-1, s^2 + 2]], by hand: s^4 + c s^3 + 4 s^2 + 2 c s + 3."""
    modes = found([[2, -1], [-1, 2]], np.eye(2), dampers(2, d0=c))
    s = np.roots([1, c, 4, 2 * c, 3])
    upper = s[s.imag > 1e-9]
    np.testing.assert_allclose(modes.s, upper[np.argsort(abs(upper))], rtol=1e-12)
    np.testing.assert_allclose(modes.real, -np.sort(-s[abs(s.imag) < 1e-9].real), rtol=1e-12)
    # The second row of the equation: x_1 = (s^2 + 2) x_2.
    np.testing.assert_allclose(modes.X[0], (modes.s**2 + 2) * modes.X[1], atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(modes.X, axis=0), 1.0, rtol=1e-14)


def test_an_overdamped_oscillator_has_two_real_roots() -> None:
    modes = found([[1]], [[1]], np.array([[3.0]]))
    assert modes.s.size == 0
    np.testing.assert_allclose(modes.real, [(-3 + 5**0.5) / 2, (-3 - 5**0.5) / 2], rtol=1e-14)


def test_a_critically_damped_oscillator_has_its_root_twice() -> None:
    modes = found([[1]], [[1]], np.array([[2.0]]))
    np.testing.assert_allclose(np.concatenate([modes.real, modes.s]), -1.0, atol=1e-7)


def test_rayleigh_ratios() -> None:
    k = np.linspace(1.0, 3.0, 20)
    K, M = chain(k, held=True), np.diag(np.linspace(1.0, 2.0, 21))
    w = modes_below(sp.csc_array(K), sp.csc_array(M), ALL)[0]
    modes = found(K, M, 0.02 * M + 0.03 * K)
    np.testing.assert_allclose(modes.omega, w, rtol=1e-12)
    np.testing.assert_allclose(modes.zeta, 0.02 / (2 * w) + 0.03 * w / 2, rtol=1e-11)


@pytest.mark.parametrize("g", [1e-3, 0.05, 1.0])
def test_structural_ratios(g: float) -> None:
    """s^2 = -(1 + i g) w^2: |s| = w (1 + g^2)^(1/4), zeta = sin(atan(g) / 2)."""
    K, M = chain(np.ones(20), held=True), np.eye(21)
    w = modes_below(sp.csc_array(K), sp.csc_array(M), ALL)[0]
    modes = found(K, M, None, g * K)
    np.testing.assert_allclose(modes.omega, w * (1 + g * g) ** 0.25, rtol=1e-12)
    np.testing.assert_allclose(modes.zeta, np.sin(np.arctan(g) / 2), rtol=1e-11)


def test_both_kinds_of_damping_on_one_mass() -> None:
    """s^2 + c s + k (1 + i g) = 0, the root above the real axis."""
    c, k, g = 0.3, 4.0, 0.1
    modes = found([[k]], [[1]], np.array([[c]]), np.array([[g * k]]))
    roots = np.roots([1, c, k * (1 + 1j * g)])
    np.testing.assert_allclose(modes.s, roots[roots.imag > 0], rtol=1e-13)


def bar(n: int, c: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Bar held at x = 0 with a damper at x = 1, EA = rho A = 1, n elements."""
    stretch, shares = n * np.array([[1, -1], [-1, 1]]), np.array([[5, 1], [1, 5]]) / (12 * n)
    K, M = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    for e in range(n):
        K[e : e + 2, e : e + 2] += stretch
        # The mean of lumped and consistent mass leaves a frequency an error of fourth order, a ratio one of second.
        M[e : e + 2, e : e + 2] += shares
    return K[1:, 1:], M[1:, 1:], dampers(n, **{f"d{n - 1}": c})


@pytest.mark.parametrize("n", [100, 300], ids=["at once", "by search"])
@pytest.mark.parametrize("c", [0.05, 0.5, 2.0])
def test_a_bar_with_a_damper_at_its_end(c: float, n: int) -> None:
    """tanh(s) = -1/c. With c < 1, s = -atanh(c) + i pi (k + 1/2); with c > 1, s = -atanh(1/c) + i pi k, k = 0 too."""
    k = np.arange(4)
    exact = -np.arctanh(c) + 1j * np.pi * (k + 0.5) if c < 1 else -np.arctanh(1 / c) + 1j * np.pi * k
    K, M, D = bar(n, c)
    none = np.empty((n, 0))
    modes = found(K, M, D, top=12.0) if n <= module.ALL_ROOTS_LIMIT else by_search(K, M, D, None, none, 12.0)
    oscillating = exact[exact.imag > 0]
    np.testing.assert_allclose(modes.s[: oscillating.size], oscillating, rtol=2 / n**2)
    np.testing.assert_allclose(modes.real, exact[exact.imag == 0].real, rtol=2 / n**2)


@pytest.mark.parametrize("c", [2.0, 1e5])
@pytest.mark.parametrize("free", [False, True], ids=["held", "free"])
def test_a_damper_that_locks_the_only_undamped_mode_in_the_band(free: bool, c: float) -> None:
    """The end of the bar is nearly held: s = -atanh(1/c) + i pi, and i pi/2 of a bar that is free at x = 0.

    Below the bound are one undamped mode or, of the free bar, its rigid motion, and the damper overdamps it.
    """
    n = 300
    K, M, D = bar(n, c)
    top, rigid = (2.0, np.ones((n + 1, 1))) if free else (3.5, np.empty((n, 0)))
    if free:
        K, M, D = np.pad(K, (1, 0)), np.pad(M, (1, 0)), np.pad(D, (1, 0))
        K[0, 0] = n
        K[0, 1] = K[1, 0] = -n
        M[0, 0], M[0, 1], M[1, 0] = 5 / (12 * n), 1 / (12 * n), 1 / (12 * n)
    modes = by_search(K, M, D, None, rigid, top)
    np.testing.assert_allclose(modes.s, [-np.arctanh(1 / c) + 1j * np.pi * (0.5 if free else 1.0)], rtol=2 / n**2)
    np.testing.assert_allclose(modes.zeta, np.sin(np.arctan(np.arctanh(1 / c) / modes.s.imag)), rtol=1e-3)


def test_a_damper_acts_on_rigid_motion() -> None:
    """A free mass on a damper has s = 0, for its position, and s = -c/m."""
    modes = found([[0]], [[2]], np.array([[3.0]]), rigid=np.array([[1 / 2**0.5]]))
    assert modes.s.size == 0
    np.testing.assert_allclose(modes.real, [-1.5], rtol=1e-14)


def test_a_damper_couples_rigid_motion_with_a_spring() -> None:
    """Two unit masses, a spring of 1 between them, a damper c on one: s (s^3 + c s^2 + 2 s + c) = 0."""
    c = 0.4
    rigid = np.full((2, 1), 0.5**0.5)
    modes = found([[1, -1], [-1, 1]], np.eye(2), dampers(2, d0=c), rigid=rigid)
    s = np.roots([1, c, 2, c])
    np.testing.assert_allclose(modes.s, s[s.imag > 0], rtol=1e-13)
    np.testing.assert_allclose(modes.real, s[abs(s.imag) < 1e-9].real, rtol=1e-13)


def test_damping_inside_a_free_body_leaves_its_rigid_motion_alone() -> None:
    """Two unit masses with spring and damper between them: s^2 + 2 c s + 2 = 0 and a rigid motion without root."""
    K = np.array([[1.0, -1], [-1, 1]])
    modes = found(K, np.eye(2), 0.1 * K, rigid=np.full((2, 1), 0.5**0.5))
    np.testing.assert_allclose(modes.s, [-0.1 + 1j * np.sqrt(2 - 0.01)], rtol=1e-14)
    assert modes.real.size == 0


def test_a_damper_behind_a_spring_without_a_mass_between() -> None:
    """m on k1, and on k2 in series with c (Zener): m c s^3 + m k2 s^2 + (k1 + k2) c s + k1 k2 = 0."""
    m, k1, k2, c = 2.0, 3.0, 5.0, 0.7
    modes = found([[k1 + k2, -k2], [-k2, k2]], np.diag([m, 0.0]), dampers(2, d1=c))
    s = np.roots([m * c, m * k2, (k1 + k2) * c, k1 * k2])
    np.testing.assert_allclose(modes.s, s[s.imag > 0], rtol=1e-13)
    np.testing.assert_allclose(modes.real, s[abs(s.imag) < 1e-9].real, rtol=1e-13)


def lossy(n: int) -> np.ndarray:
    return 0.03 * chain(np.where(np.arange(n - 1) < n // 3, 1.0, 0.1) * n**2)


def two_thirds(n: int) -> np.ndarray:
    return 1e-3 * chain(np.where(np.arange(n - 1) < 2 * n // 3, 1.0, 0.0) * n**2)


HARD = {
    "one damper": (lambda n: dampers(n, d17=300.0), None),
    "dampers that lock a third": (lambda n: dampers(n, **{f"d{i}": 30.0 * n for i in range(20, 60)}), None),
    "unlike materials, viscous": (two_thirds, None),
    "unlike materials, structural": (None, lossy),
    "both": (lambda n: dampers(n, d17=30.0), lossy),
}


@pytest.mark.parametrize("free", [False, True], ids=["held", "free"])
@pytest.mark.parametrize("case", HARD)
def test_search_finds_what_all_roots_at_once_hold(case: str, free: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    n, top = 200, 50.0
    D, loss = (None if law is None else law(n) for law in HARD[case])
    K, M = chain(np.full(n - 1, float(n**2)), held=not free), np.eye(n)
    rigid = np.full((n, 1), n**-0.5) if free else np.empty((n, 0))
    sought = by_search(K, M, D, loss, rigid, top)
    monkeypatch.setattr(module, "ALL_ROOTS_LIMIT", n)
    all_at_once = found(K, M, D, loss, rigid, top)
    assert sought.s.size == all_at_once.s.size >= 12
    np.testing.assert_allclose(sought.omega, all_at_once.omega, rtol=1e-7)
    np.testing.assert_allclose(sought.zeta, all_at_once.zeta, rtol=1e-6)
    # The search is for oscillating roots; the real roots found with them are accurate too.
    assert sought.real.size >= min(all_at_once.real.size, 2)
    for root in sought.real:
        assert abs(all_at_once.real / root - 1).min() < 1e-5
    np.testing.assert_allclose(abs(np.sum(sought.X.conj() * all_at_once.X, axis=0)), 1.0, atol=1e-6)


def test_soft_modes_beside_stiff_springs_keep_the_digits_of_their_ratios() -> None:
    """Pairs of masses on springs a million times as stiff move as one mass, so that the chain has a closed form."""
    n, stiff = 200, 2.0**23
    k = np.where(np.arange(n - 1) % 2 == 0, stiff, 1.0)
    K = chain(k)
    K[0, 0] += 2.0
    c = np.where(np.arange(n - 1) % 2 == 0, 0.0, 1.0)
    D = 0.05 * chain(c)
    D[0, 0] += 0.1
    modes = by_search(K, np.eye(n), D, None, np.empty((n, 0)), 0.3)
    # 100 masses of 2 on unit springs, the first held by a spring of 2 to the ground.
    w = np.sqrt(2.0) * np.sin((2 * np.arange(1, modes.s.size + 1) - 1) * np.pi / 400)
    np.testing.assert_allclose(modes.omega, w, rtol=1e-6)
    np.testing.assert_allclose(modes.zeta, 0.05 * w / 2, rtol=1e-6)


def test_repeated_modes_are_found_twice() -> None:
    """A square membrane of masses on strings has equal modes (i, j) and (j, i); D = beta K."""
    m, beta = 15, 0.02
    line = 2 * np.eye(m) - np.eye(m, k=1) - np.eye(m, k=-1)
    K = np.kron(np.eye(m), line) + np.kron(line, np.eye(m))
    lam = 4 * np.sin(np.arange(1, m + 1) * np.pi / (2 * m + 2)) ** 2
    w = np.sort(np.sqrt(lam[:, None] + lam).ravel())
    w = w[w <= 0.8]
    modes = by_search(K, np.eye(m * m), beta * K, None, np.empty((m * m, 0)), 0.8)
    np.testing.assert_allclose(modes.omega, w, rtol=1e-9)
    np.testing.assert_allclose(modes.zeta, beta * w / 2, rtol=1e-9)


def test_a_large_system_needs_a_start() -> None:
    n = module.ALL_ROOTS_LIMIT + 1
    with pytest.raises(MatrixError, match=f"a system of {n} coordinates needs its undamped modes"):
        found(np.eye(n), np.eye(n), np.eye(n))


def test_roots_that_do_not_settle_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ROUNDS", 1)
    n = 200
    with pytest.raises(MatrixError, match=r"Hz did not settle in 1 rounds: it is known to .* of its decay rate"):
        by_search(chain(np.full(n - 1, 1e4), held=True), np.eye(n), dampers(n, d17=300.0), None, np.empty((n, 0)), 20.0)


def gyroscopic(n: int, rigid: int, damping: float, seed: int) -> tuple[np.ndarray, ...]:
    """Stiffness, mass, damping with a skew part of rank 4, and rigid motions orthonormal in the mass."""
    rng = np.random.default_rng(seed)
    A, B, U, C = (rng.standard_normal((n, k)) for k in (n, n - rigid, 4, 2))
    M, K = A @ A.T / n + np.eye(n), B @ np.diag(10 ** np.linspace(0, 4, n - rigid)) @ B.T / n
    J = 3.0 * np.kron([[0, 1], [-1, 0]], np.eye(2))
    N = la.null_space(K, rcond=1e-10)[:, :rigid] if rigid else np.zeros((n, 0))
    N = N @ la.inv(la.cholesky(N.T @ M @ N)) if rigid else N
    return K, M, damping * C @ C.T + U @ J @ U.T, N


@pytest.mark.parametrize("rigid", [0, 1, 2, 3])
@pytest.mark.parametrize("damping", [0.0, 0.05])
def test_gyroscopic_forces_against_the_companion_matrix(rigid: int, damping: float) -> None:
    """Free motions that couple with each other, or an odd one with elastic motion alone."""
    K, M, D, N = gyroscopic(13, rigid, damping, seed=rigid)
    s = companion_roots(K, M, D)
    top = 1.01 * abs(s[6])
    found = complex_modes(DampedPencil(K, M, D, None), top, N)
    assert found.s.size == np.count_nonzero(abs(s) <= top)
    np.testing.assert_allclose(found.s, s[: found.s.size], rtol=1e-7, atol=1e-9 * abs(s[-1]))
    for root, x in zip(found.s, found.X.T, strict=True):
        size = abs(root) ** 2 * abs(M @ x).max()
        assert abs((root**2 * M + root * D + K) @ x).max() < 1e-6 * size


def test_gyroscopic_forces_bring_modes_from_above_the_band(monkeypatch: pytest.MonkeyPatch) -> None:
    """A basis that grows from the undamped modes of the band finds the roots of all shapes."""
    K, M, D, N = gyroscopic(60, 2, 0.02, seed=8)
    lam, Phi = elastic_pairs(K, M, N)
    w = np.sqrt(lam)
    top, s = w[5], companion_roots(K, M, D)
    s = s[abs(s) <= top]
    # The lowest root is 1/600 of the lowest undamped frequency, far more than damping would do.
    assert abs(s[0]) < 0.01 * w[0]
    monkeypatch.setattr(module, "_ALL_GYROSCOPIC", 20)
    start = w[w < 1.25 * top], Phi[:, w < 1.25 * top]
    np.testing.assert_allclose(complex_modes(DampedPencil(K, M, D, None), top, N, start).s, s, rtol=1e-6)


def companion_roots(K: np.ndarray, M: np.ndarray, D: np.ndarray) -> np.ndarray:
    """Oscillating roots by ascending size."""
    n = len(K)
    s = la.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]]))
    s = s[s.imag > 2e-5]
    return s[np.argsort(abs(s))]
