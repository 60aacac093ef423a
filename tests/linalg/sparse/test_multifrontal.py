"""Multifrontal factors as a backend: when they are used, which matrices are refused, and the modes that they give."""

from itertools import pairwise

import numpy as np
import pytest

from cmsreduce.linalg.eigen import beside_modes, certified_modes, count_below
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import InsufficientMemoryError, NotPositiveDefiniteError, factorise
from cmsreduce.linalg.sparse import factorisation as module
from cmsreduce.linalg.sparse.multifrontal import Multifrontal
from tests.solids import block

CUBE = block("cube", (1.0, 1.0, 1.0), (15, 15, 15), held=range(1, 257))
BAR = block("bar", (3.0, 0.4, 0.3), (40, 5, 5), held=range(1, 37))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("row", [0, 1700, -1])
def test_an_indefinite_matrix_is_refused(threads, row):
    A = CUBE.K.copy()
    A[row, row] *= -1
    with (
        solver_settings(SolverSettings("multifrontal", threads=threads)),
        pytest.raises(NotPositiveDefiniteError, match="the cube is not positive definite"),
    ):
        factorise(A, what="the cube")


def test_auto_takes_it_for_large_definite_matrices(monkeypatch):
    monkeypatch.setattr(module, "LARGE", CUBE.n)
    with solver_settings(SolverSettings()) as settings:
        assert isinstance(factorise(CUBE.K), Multifrontal)
        factorise(CUBE.K[:-1][:, :-1])
        factorise(CUBE.K, definite=False)
    taken = [work.backend for work in settings.work]
    assert taken[0] == "multifrontal" and "multifrontal" not in taken[1:]


@pytest.mark.pardiso
def test_auto_takes_the_first_factor_that_fits(monkeypatch):
    """The factor may fit without its updates, and in single precision where double does not fit."""
    monkeypatch.setattr(module, "LARGE", 1)
    needs = {}
    for backend in ("multifrontal", "pardiso"):
        for precision in ("double", "single"):
            with solver_settings(SolverSettings(backend, precision=precision)) as settings:
                factorise(CUBE.K)
            needs[backend, precision] = settings.work[0].mib * 2**20
    by_need = sorted(needs, key=needs.__getitem__)
    assert needs["multifrontal", "single"] < 0.6 * needs["multifrontal", "double"]
    for (backend, precision), above in pairwise(by_need):
        with solver_settings(SolverSettings(memory=(needs[backend, precision] + needs[above]) / 2)) as settings:
            x = factorise(CUBE.K)(CUBE.K @ np.ones(CUBE.n))
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
        factorise(CUBE.K)


def test_solutions_in_single_precision_are_refined():
    x = np.random.default_rng(4).standard_normal((CUBE.n, 5)) * [1e-60, 1.0, 1e60, 0.0, 3.0]
    with solver_settings(SolverSettings("multifrontal", precision="single")) as settings:
        factor = factorise(CUBE.K)
        found = factor(CUBE.K @ x)
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
