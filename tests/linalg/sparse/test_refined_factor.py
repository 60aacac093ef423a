"""Factors in single precision give solutions in double precision and the inertia of the matrix, or are refused."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import certified_modes, count_below
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import InsufficientMemoryError, factorise
from tests.linalg.sparse.test_factorise import BODIES, BRICKS, SPECTRA, TOWER, banded, mast
from tests.solids import block

pytestmark = pytest.mark.pardiso
SINGLE = SolverSettings("pardiso", precision="single")
# Error of a refined solution in the energy norm: rounding times the condition of the matrix.
ACCURACY = 1e-11


@pytest.mark.parametrize("name", ["solid", "frame", "banded"])
def test_solutions_are_those_of_double_precision(name):
    A = BODIES[name]
    x = np.random.default_rng(1).standard_normal((A.shape[0], 5))
    with solver_settings(SolverSettings("pardiso", precision="single")) as settings:
        factor = factorise(A)
        found = factor(A @ x)
    assert [work.precision for work in settings.work] == ["single"]
    energy = [np.sqrt(np.einsum("ij,ij->j", u, A @ u)) for u in (found - x, x)]
    assert (energy[0] <= ACCURACY * energy[1]).all()
    # Without refinement the error would be that of seven digits times the condition.
    assert factor.contraction > 1e-9


def test_columns_of_any_size_are_refined():
    """float32 cannot represent 1e-60 or 1e60."""
    A = BODIES["solid"]
    x = np.random.default_rng(2).standard_normal((A.shape[0], 4)) * [1e-60, 1.0, 1e60, 0.0]
    with solver_settings(SINGLE):
        found = factorise(A)(A @ x)
    assert (abs(found - x).max(axis=0) <= 1e-9 * abs(x).max(axis=0)).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.93])
def test_the_inertia_is_the_matrix_s_own(seed, share):
    A = banded(120, seed)
    lam = la.eigvalsh(A.toarray())
    below = int(share * lam.size)
    shift = (lam[below - 1] + lam[below]) / 2 if below else lam[0] / 2
    with solver_settings(SINGLE):
        assert factorise(sp.csc_array(A - shift * sp.eye_array(120)), definite=False).negative_pivots == below


@pytest.mark.parametrize("nearness", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
@pytest.mark.parametrize("body", [BRICKS, TOWER], ids=lambda body: body.name)
def test_near_an_eigenvalue_the_count_is_right_or_refused(body, nearness):
    lam = SPECTRA[body.name]
    refused = 0
    for mode in (1, 4, 9):
        for side in (-1, 1):
            sigma = lam[mode] * (1 + side * nearness)
            with solver_settings(SINGLE):
                try:
                    factor = factorise(sp.csc_array(body.K - sigma * body.M), definite=False)
                except MatrixError:
                    refused += 1
                    continue
            assert factor.negative_pivots == np.count_nonzero(lam < sigma)
    assert refused == 0 or nearness < 1e-1


@pytest.mark.parametrize("A", [mast(2000), BODIES["penalty"]], ids=["mast", "penalty"])
def test_a_matrix_that_cannot_be_refined_is_refused(A):
    """2000 elements in a row, or springs of 1e12 beside springs of 1, are too ill conditioned for seven digits."""
    rows = rf"\({A.shape[0]} rows\) is too ill conditioned .* single"
    with solver_settings(SINGLE), pytest.raises(MatrixError, match=rows):
        factorise(A)
    x = np.ones(A.shape[0])
    with solver_settings(SolverSettings("pardiso")):
        assert np.isfinite(factorise(A)(A @ x)).all()


def test_single_precision_is_taken_where_double_does_not_fit():
    # The cube is so large that its entries take more memory than PARDISO's threads.
    A = block("cube", (1.0, 1.0, 1.0), (15, 15, 15), held=range(1, 257)).K
    needs = {}
    for precision in ("double", "single"):
        with solver_settings(SolverSettings("pardiso", precision=precision)) as settings:
            factorise(A)
        needs[precision] = settings.work[0].mib * 2**20
    assert needs["single"] < 0.75 * needs["double"]
    between = (needs["single"] + needs["double"]) / 2
    with solver_settings(SolverSettings("pardiso", memory=between)) as settings:
        factor = factorise(A)
    assert [work.precision for work in settings.work] == ["single"]
    x = np.random.default_rng(3).standard_normal(A.shape[0])
    np.testing.assert_allclose(factor(A @ x), x, rtol=0, atol=1e-9)
    for limits in ({"memory": between, "precision": "double"}, {"memory": 0.5 * needs["single"]}):
        with solver_settings(SolverSettings("pardiso", **limits)), pytest.raises(InsufficientMemoryError):
            factorise(A)


def test_other_solvers_have_no_single_precision():
    with (
        solver_settings(SolverSettings("superlu", precision="single")),
        pytest.raises(MatrixError, match="precision, superlu does not"),
    ):
        factorise(BODIES["banded"])


def test_certified_modes_do_not_depend_on_the_precision():
    body = block("bar", (3.0, 0.4, 0.3), (30, 3, 3), held=range(1, 17))
    # From the inverse problem: rounding is then relative to the lowest eigenvalue, not to the highest.
    lam = 1 / la.eigvalsh(body.M.toarray(), body.K.toarray())[::-1]
    omega = float(np.sqrt((lam[29] + lam[30]) / 2))
    with solver_settings(SINGLE):
        count = count_below(body.K, body.M, omega)
        modes = certified_modes(body.K, body.M, omega, count=count)
    assert count == 30
    np.testing.assert_allclose(modes.omega**2, lam[:30], rtol=1e-9)
    assert (modes.bound < 1e-7).all()
