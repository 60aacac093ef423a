"""Modes from factors in single precision against dense algebra in double, and static solves with known modes."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import beside_modes, certified_modes, eigenpairs, mixed_precision
from cmsreduce.linalg.eigen.mixed_precision import corrected_modes
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import ElasticFlexibility, RefinedFactor, factorise, rough_solve
from tests.solids import block

pytestmark = pytest.mark.pardiso
SINGLE = SolverSettings("pardiso", precision="single")
BAR = block("bar", (3.0, 0.4, 0.3), (30, 3, 3), held=range(1, 17))
FREE = block("free", (3.0, 0.4, 0.3), (16, 3, 3))
# A square section has its modes in pairs.
POST = block("post", (2.0, 0.4, 0.4), (20, 4, 4), held=range(1, 26))


@pytest.fixture
def corrected(monkeypatch):
    """Make the test fail if corrections do not find the modes and refined solves are used."""
    monkeypatch.setattr(eigenpairs, "counted_modes", None)


@cache
def spectrum(body):
    """Eigenvalues from the inverse problem, in which the low ones keep their digits."""
    return 1 / la.eigvalsh(body.M.toarray(), body.K.toarray())[::-1]


def solved(A, b):
    """Solution to all digits of a double, refined with residuals in long double."""
    dense, factor = A.toarray(), la.cho_factor(A.toarray())
    x, more = np.zeros(b.shape, np.longdouble), dense.astype(np.longdouble)
    for _ in range(6):
        x += la.cho_solve(factor, (b - more @ x).astype(np.float64))
    return x.astype(np.float64)


@pytest.mark.usefixtures("corrected")
@pytest.mark.parametrize("wanted", [1, 7, 30, 120])
@pytest.mark.parametrize("body", [BAR, POST], ids=lambda body: body.name)
def test_modes_are_those_of_double_precision(body, wanted):
    lam = spectrum(body)
    wanted += int(lam[wanted] < lam[wanted - 1] * (1 + 1e-6))
    omega = float(np.sqrt((lam[wanted - 1] + lam[wanted]) / 2))
    with solver_settings(SINGLE):
        found = certified_modes(body.K, body.M, omega, count=wanted)
    assert found.omega.size == wanted
    error = abs(found.omega / np.sqrt(lam[:wanted]) - 1)
    # In the reference the rounding of the lowest eigenvalue affects all others.
    rounding = 20 * np.finfo(float).eps * lam[wanted - 1] / lam[0]
    assert error.max() < 1e-10 and (error <= found.bound + rounding).all() and found.bound.max() < 1e-9
    inertia = body.M @ found.Phi
    np.testing.assert_allclose(found.Phi.T @ inertia, np.eye(wanted), rtol=0, atol=1e-12)
    left = np.linalg.norm(body.K @ found.Phi - inertia * found.omega**2, axis=0)
    assert (left <= 1e-7 * np.linalg.norm(inertia, axis=0) * found.omega**2).all()


@pytest.mark.usefixtures("corrected")
@pytest.mark.parametrize("interface", [None, np.arange(48)], ids=["anywhere", "interface"])
def test_elastic_modes_of_a_free_body_are_those_of_double_precision(interface):
    wanted = 12
    x, y, z = FREE.nodes.xyz.T
    one, none = np.ones_like(x), np.zeros_like(x)
    motions = [(one, none, none), (none, one, none), (none, none, one), (none, -z, y), (z, none, -x), (-y, x, none)]
    R = np.array([np.column_stack(motion).ravel() for motion in motions]).T
    rigid = la.solve_triangular(la.cholesky(R.T @ FREE.M @ R), R.T, trans="T").T
    # Rigid motions are moved beyond the modes sought.
    inertia, M = FREE.M @ rigid, FREE.M.toarray()
    far = 1e3 * la.eigh(FREE.K.toarray(), M, eigvals_only=True, subset_by_index=(20, 20))[0]
    lam = 1 / la.eigvalsh(M, FREE.K.toarray() + far * inertia @ inertia.T)[::-1]
    with solver_settings(SINGLE):
        solve = ElasticFlexibility(FREE.K, FREE.M, rigid, interface)
        assert rough_solve(solve) is not None
        found = certified_modes(
            FREE.K, FREE.M, float(np.sqrt((lam[wanted - 1] + lam[wanted]) / 2)), rigid=rigid, solve=solve, count=wanted
        )
    error = abs(found.omega / np.sqrt(lam[:wanted]) - 1)
    assert found.omega.size == wanted and error.max() < 1e-10 and found.bound.max() < 1e-9
    assert abs(found.Phi.T @ inertia).max() < 1e-12


def test_more_copies_of_a_mode_than_columns_of_a_block_are_found():
    """Twenty separate equal bars: a block of eight columns finds eight copies of a mode."""
    one = block("bar", (3.0, 0.4, 0.3), (6, 1, 1), held=range(1, 5))
    lam = spectrum(one)
    copies = 20
    K, M = (sp.csc_array(sp.block_diag([A] * copies)) for A in (one.K, one.M))
    omega = float(np.sqrt((lam[2] + lam[3]) / 2))
    with solver_settings(SINGLE):
        found = certified_modes(K, M, omega, count=3 * copies)
    np.testing.assert_allclose(found.omega**2, np.repeat(lam[:3], copies), rtol=1e-9)


@pytest.mark.parametrize("mistake", [-1, 1])
def test_a_wrong_count_gives_no_modes(mistake):
    lam = spectrum(BAR)
    high = (lam[9] + lam[10]) / 2
    with solver_settings(SINGLE):
        factor = factorise(BAR.K)
        assert isinstance(factor, RefinedFactor)
        found = corrected_modes(BAR.K, BAR.M, rough_solve(factor), high, 10 + mistake, 1e-9, np.empty((BAR.n, 0)))
    assert found is None or mistake < 0


def test_if_corrections_fail_refined_solves_find_the_modes(monkeypatch):
    def singular(*_):
        raise la.LinAlgError

    monkeypatch.setattr(mixed_precision, "_ritz", singular)
    lam = spectrum(BAR)
    with solver_settings(SINGLE):
        found = certified_modes(BAR.K, BAR.M, float(np.sqrt((lam[6] + lam[7]) / 2)), count=7)
    np.testing.assert_allclose(found.omega**2, lam[:7], rtol=1e-9)


def test_a_static_solve_with_known_modes_takes_two_rough_ones(monkeypatch):
    lam = spectrum(BAR)
    b = np.random.default_rng(1).standard_normal((BAR.n, 6))
    with solver_settings(SINGLE):
        factor = factorise(BAR.K)
        modes = certified_modes(BAR.K, BAR.M, float(np.sqrt((lam[29] + lam[30]) / 2)), solve=factor, count=30)
        alone = factor(b)
        known = beside_modes(factor, BAR.M, modes.omega, modes.Phi)
        calls = []
        rough = RefinedFactor.rough
        monkeypatch.setattr(RefinedFactor, "rough", lambda self, c: calls.append(c.shape) or rough(self, c))
        found = known(b)
    assert calls == [b.shape] * 2
    with solver_settings(SolverSettings("pardiso")):
        double = factorise(BAR.K)(b)
    exact = solved(BAR.K, b)
    errors = [np.sqrt(np.einsum("ij,ij->j", x - exact, BAR.K @ (x - exact))).max() for x in (alone, found, double)]
    size = np.sqrt(np.einsum("ij,ij->j", exact, BAR.K @ exact)).min()
    assert max(errors) <= 1e-10 * size


def test_a_factor_in_double_precision_is_returned_unchanged():
    with solver_settings(SolverSettings("pardiso")):
        factor = factorise(BAR.K)
    assert beside_modes(factor, BAR.M, np.ones(1), np.ones((BAR.n, 1))) is factor
