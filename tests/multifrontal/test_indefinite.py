"""Factors of indefinite matrices: their negative pivots are the dense count, with and without the factor's entries."""

from functools import cache

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.multifrontal import (
    CholeskyFactor,
    FactorSize,
    NotPositiveDefiniteError,
    UnstableError,
    nested_dissection,
)
from cmsreduce.multifrontal.panels import STRIP, row_scale
from tests.multifrontal.matrices import backward_error, lattice

EPS = np.finfo(float).eps
# Its last separator has several strips.
CUBE = lattice(8, 8, 8)
ORDER = nested_dissection(CUBE)
N = CUBE.shape[0]
MASS = sp.diags_array(np.random.default_rng(5).uniform(0.5, 2.0, N), format="csc")


@cache
def spectrum() -> np.ndarray:
    return la.eigvalsh(CUBE.toarray(), np.diag(MASS.diagonal()), overwrite_a=True)


def shifted(share: float) -> tuple[sp.csc_array, int]:
    """CUBE less a multiple of its mass, and the number of its negative eigenvalues."""
    below = int(share * N)
    lam = spectrum()
    sigma = lam[0] / 2 if not below else 2 * lam[-1] if below == N else (lam[below - 1] + lam[below]) / 2
    return sp.csc_array(CUBE - sigma * MASS), below


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("share", [0.0, 0.003, 0.02, 0.1, 0.4, 0.8, 1.0])
def test_negative_pivots_are_the_dense_count(threads, share):
    A, below = shifted(share)
    counted = CholeskyFactor(A, ORDER, threads=threads, indefinite=True, kept=False)
    factor = CholeskyFactor(A, ORDER, threads=threads, indefinite=True)
    assert (counted.negative, factor.negative) == (below, below)
    assert counted.growth == factor.growth
    assert np.count_nonzero(factor.pivots < 0) == below


@pytest.mark.parametrize("layout", ["C", "F"])
@pytest.mark.parametrize("share", [0.003, 0.1, 0.8])
def test_solutions_lose_no_more_digits_than_the_growth_says(share, layout):
    A, _ = shifted(share)
    factor = CholeskyFactor(A, ORDER, threads=2, indefinite=True)
    b = np.asarray(np.random.default_rng(0).standard_normal((N, 9)), order=layout)
    x = factor.solve(b)
    assert backward_error(A, x, b) < 50 * EPS * factor.growth
    single = CholeskyFactor(A, ORDER, scale=row_scale(A.indptr, A.data), indefinite=True)
    assert single.negative == factor.negative
    assert backward_error(A, single.solve(b), b) < 50 * np.finfo(np.float32).eps * factor.growth


def test_of_a_definite_matrix_it_is_cholesky_s_factor():
    b = np.ones((N, 2))
    cholesky, factor = CholeskyFactor(CUBE, ORDER), CholeskyFactor(CUBE, ORDER, indefinite=True)
    assert (factor.growth, factor.negative) == (1.0, 0)
    np.testing.assert_allclose(factor.solve(b), cholesky.solve(b), rtol=1e-12)


def test_rows_of_any_unit_have_their_own_scale():
    """Metres beside micrometres: eigenvectors of unscaled blocks would lose the soft rows."""
    A, below = shifted(0.1)
    unit = sp.diags_array(10.0 ** np.random.default_rng(1).integers(-6, 7, N))
    factor = CholeskyFactor(sp.csc_array(unit @ A @ unit), ORDER, indefinite=True)
    assert factor.negative == below


def test_a_count_takes_the_memory_of_the_updates_and_of_one_front():
    seen: list[FactorSize] = []
    counted = CholeskyFactor(CUBE, ORDER, indefinite=True, kept=False, admit=seen.append)
    CholeskyFactor(CUBE, ORDER, admit=seen.append)
    largest = max(np.diff(counted._tree.first) + np.diff(counted._tree.begin))
    assert seen[0].stored == 0 and seen[0].entries == seen[1].entries
    assert counted._blocks.values.size == 0
    assert seen[0].bytes < seen[1].bytes - seen[1].stored + 8 * (largest**2 + 2 * N)
    with pytest.raises(ValueError, match="cannot solve"):
        counted.solve(np.ones((N, 1)))
    with pytest.raises(ValueError, match="pivots"):
        _ = counted.pivots


@pytest.mark.parametrize("gap", [0.0, 1e-9])
def test_pivots_that_the_order_does_not_allow_are_refused(gap):
    """Rows with almost nothing on the diagonal that are eliminated before the rows that they couple with."""
    n = 4 * STRIP
    B = np.eye(n) + 0.1 * np.random.default_rng(2).standard_normal((n, n))
    A = sp.csc_array(np.block([[gap * np.eye(n), B], [B.T, np.eye(n)]]))
    with pytest.raises(UnstableError):
        CholeskyFactor(A, np.arange(2 * n), indefinite=True)
    assert CholeskyFactor(A, np.arange(2 * n)[::-1].copy(), indefinite=True).negative == n


def test_a_definite_matrix_must_be_definite():
    A, _ = shifted(0.02)
    with pytest.raises(NotPositiveDefiniteError):
        CholeskyFactor(A, ORDER)
