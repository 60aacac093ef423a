"""Multifrontal factors as a backend: when they are used, which matrices are refused, and the modes that they give."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.eigen import beside_modes, certified_modes, count_below
from cmsreduce.linalg.eigen.spectrum_slicing import sturm_count
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import InsufficientMemoryError, NotPositiveDefiniteError, factorise
from cmsreduce.linalg.sparse import factorisation as module
from cmsreduce.linalg.sparse.multifrontal import Multifrontal
from cmsreduce.multifrontal import factor as package
from tests.linalg.sparse.test_factorise import BRICKS, SPECTRA, TOWER
from tests.solids import block


@cache
def cube():
    """Not made while tests are collected, which every process does."""
    return block("cube", (1.0, 1.0, 1.0), (15, 15, 15), held=range(1, 257))


BAR = block("bar", (3.0, 0.4, 0.3), (40, 5, 5), held=range(1, 37))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("row", [0, 1700, -1])
def test_an_indefinite_matrix_is_refused(threads, row):
    A = cube().K.copy()
    A[row, row] *= -1
    with (
        solver_settings(SolverSettings("multifrontal", threads=threads)),
        pytest.raises(NotPositiveDefiniteError, match="the cube is not positive definite"),
    ):
        factorise(A, what="the cube")


def test_auto_takes_it_for_large_matrices(monkeypatch):
    monkeypatch.setattr(module, "LARGE", cube().n)
    with solver_settings(SolverSettings()) as settings:
        assert isinstance(factorise(cube().K), Multifrontal)
        factorise(cube().K[:-1][:, :-1])
        factorise(cube().K, definite=False)
    taken = [work.backend == "multifrontal" for work in settings.work]
    # Without MKL it is the quickest for smaller ones, too.
    assert taken == [True, not module.installed("pardiso"), True]


def test_an_unconnected_part_takes_the_solver_of_the_whole(monkeypatch):
    """Eigenvalues of a chain of n masses and springs held at both ends: 4 sin^2(k pi / 2 (n + 1))."""
    n, shift = 40, 1.1
    monkeypatch.setattr(module, "LARGE", 3 * n)
    chain = sp.diags_array([-1.0, 2.0 - shift, -1.0], offsets=[-1, 0, 1], shape=(n, n), format="csc")
    with solver_settings(SolverSettings()) as settings:
        counts = [
            factorise(chain, definite=False, solves=False, whole=whole).negative_pivots
            for whole in (0, 3 * n - 1, 3 * n)
        ]
    assert counts == 3 * [np.count_nonzero(4 * np.sin(np.arange(1, n + 1) * np.pi / 2 / (n + 1)) ** 2 < shift)]
    assert [work.backend == "multifrontal" for work in settings.work] == [False, False, True]


@pytest.mark.pardiso
def test_auto_takes_the_first_factor_that_fits(monkeypatch):
    """The factor may fit without its updates, and in single precision where double does not fit."""
    monkeypatch.setattr(module, "LARGE", 1)
    needs = {}
    for backend in ("multifrontal", "pardiso"):
        for precision in ("double", "single"):
            with solver_settings(SolverSettings(backend, precision=precision)) as settings:
                factorise(cube().K)
            needs[backend, precision] = settings.work[0].mib * 2**20
    by_need = sorted(needs, key=needs.__getitem__)
    assert needs["multifrontal", "single"] < 0.6 * needs["multifrontal", "double"]
    for (backend, precision), above in pairwise(by_need):
        with solver_settings(SolverSettings(memory=(needs[backend, precision] + needs[above]) / 2)) as settings:
            x = factorise(cube().K)(cube().K @ np.ones(cube().n))
        np.testing.assert_allclose(x, 1.0, rtol=0, atol=1e-9)
        taken = settings.work[0]
        assert needs[taken.backend, taken.precision] <= needs[backend, precision]
        # Double precision is taken if it fits.
        assert (taken.precision == "double") == any(
            kind[1] == "double" for kind in by_need[: by_need.index((backend, precision)) + 1]
        )
    with (
        solver_settings(SolverSettings("multifrontal", memory=0.9 * needs["multifrontal", "single"])),
        pytest.raises(InsufficientMemoryError, match="GiB may be used"),
    ):
        factorise(cube().K)


def test_solutions_in_single_precision_are_refined():
    x = np.random.default_rng(4).standard_normal((cube().n, 5)) * [1e-60, 1.0, 1e60, 0.0, 3.0]
    with solver_settings(SolverSettings("multifrontal", precision="single")) as settings:
        factor = factorise(cube().K)
        found = factor(cube().K @ x)
    assert [(work.backend, work.precision) for work in settings.work] == [("multifrontal", "single")]
    assert (abs(found - x).max(axis=0) <= 1e-9 * abs(x).max(axis=0)).all()
    assert factor.contraction > 1e-9 and factor.negative_pivots == 0


@pytest.mark.parametrize("precision", ["double", "single"])
def test_modes_and_static_shapes_are_those_of_superlu(precision):
    omega, found = 2 * np.pi * 4000.0, []
    b = np.random.default_rng(6).standard_normal((BAR.n, 4))
    count = count_below(BAR.K, BAR.M, omega)
    assert count is not None and count > 20
    for backend, wanted in (("superlu", "double"), ("multifrontal", precision)):
        with solver_settings(SolverSettings(backend, precision=wanted)):
            factor = factorise(BAR.K)
            modes = certified_modes(BAR.K, BAR.M, omega, solve=factor, count=count)
            found.append((modes.omega, beside_modes(factor, BAR.M, modes.omega, modes.Phi)(b)))
    (omega_0, x_0), (omega_1, x_1) = found
    np.testing.assert_allclose(omega_1, omega_0, rtol=1e-9)
    np.testing.assert_allclose(x_1, x_0, rtol=0, atol=1e-9 * abs(x_0).max())


@pytest.mark.parametrize("body", [BRICKS, TOWER], ids=lambda body: body.name)
def test_counts_without_a_stored_factor_are_the_dense_counts(monkeypatch, body):
    monkeypatch.setattr(module, "LARGE", 1)
    lam = SPECTRA[body.name]
    between = np.sqrt(lam[:-1] * lam[1:])[:: max(lam.size // 25, 1)]
    with solver_settings(SolverSettings(threads=2)) as settings:
        found = [sturm_count(body.K, body.M, np.sqrt(sigma)) for sigma in between]
    np.testing.assert_array_equal(found, np.searchsorted(lam, between))
    assert {(work.backend, work.file_mib) for work in settings.work} <= {("multifrontal", 0.0), ("pardiso", 0.0)}
    # High in the spectrum, growth may ask for other pivots.
    assert [work.backend for work in settings.work[:5]] == ["multifrontal"] * 5


def test_a_count_needs_less_memory_than_a_factor(monkeypatch):
    monkeypatch.setattr(module, "LARGE", 1)
    with solver_settings(SolverSettings("multifrontal", threads=1)) as settings:
        factorise(cube().K)
        factorise(cube().K, definite=False, solves=False)
    stored, counted = (work.mib for work in settings.work)
    assert counted < 0.7 * stored
    with solver_settings(SolverSettings(threads=1, memory=(counted + stored) / 2 * 2**20)) as settings:
        assert factorise(cube().K, definite=False, solves=False).negative_pivots == 0
    assert [(work.backend, work.precision) for work in settings.work] == [("multifrontal", "double")]


def test_a_matrix_that_needs_other_pivots_goes_to_another_solver(monkeypatch):
    monkeypatch.setattr(module, "LARGE", 1)
    monkeypatch.setattr(package, "_GROWTH", 1.0)
    A = sp.csc_array(BRICKS.K - SPECTRA[BRICKS.name][40] * 1.001 * BRICKS.M)
    for solves in (True, False):
        with solver_settings(SolverSettings(threads=1)) as settings:
            assert factorise(A, definite=False, solves=solves).negative_pivots == 41
        assert settings.work[0].backend in ("pardiso", "superlu")
