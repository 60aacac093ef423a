"""Multifrontal factors with blocks of several panels, on any number of threads, in both precisions."""

import subprocess
import sys
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

import cmsreduce.multifrontal as package
from cmsreduce.multifrontal import CholeskyFactor, FactorSize, NotPositiveDefiniteError, nested_dissection
from cmsreduce.multifrontal.fronts import PANEL
from tests.multifrontal.matrices import backward_error, factor_entries, lattice, shuffled

EPS = np.finfo(float).eps
# The last separator alone has more columns than a panel.
CUBE = lattice(16, 16, 16)


@cache
def cube_factor(threads: int) -> CholeskyFactor:
    return CholeskyFactor(CUBE, threads=threads)


def random(k: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((CUBE.shape[0], k))


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("k", [1, 2, 7, 8, 33])
def test_fronts_of_several_panels_give_exact_solutions(threads, k):
    factor, b = cube_factor(threads), random(k)
    assert np.diff(factor._tree.first).max() > PANEL
    x = factor.solve(b)
    assert backward_error(CUBE, x, b) < 50 * EPS
    np.testing.assert_allclose(factor.solve(b[:, :1]), x[:, :1], rtol=0, atol=1e-12 * abs(x).max())


@pytest.mark.parametrize(
    "A", [sp.csc_array([[4.0]]), sp.csc_array(sp.eye_array(9)), lattice(80, dofs=1)], ids=["one", "diagonal", "chain"]
)
@pytest.mark.parametrize("threads", [1, 4])
def test_small_and_uncoupled_matrices(A, threads):
    x = np.arange(1.0, A.shape[0] + 1)[:, None] * [1.0, -2.0]
    np.testing.assert_allclose(CholeskyFactor(A, threads=threads).solve(A @ x), x, rtol=1e-10)


@pytest.mark.parametrize("layout", ["by columns", "by rows", "neither"])
def test_solutions_have_the_layout_of_the_right_hand_sides(layout):
    b = {"by columns": np.asfortranarray(random(5)), "by rows": random(5), "neither": random(10)[:, ::2]}[layout]
    before = b.copy()
    x = cube_factor(1).solve(b)
    assert x.flags.c_contiguous if layout == "by rows" else x.flags.f_contiguous
    np.testing.assert_array_equal(b, before)
    assert backward_error(CUBE, x, b) < 50 * EPS


def test_without_right_hand_sides_there_is_nothing_to_solve():
    assert cube_factor(1).solve(random(0)).shape == (CUBE.shape[0], 0)


def test_solutions_do_not_depend_on_threads_beyond_rounding():
    found = [CholeskyFactor(CUBE, threads=threads).solve(random(3)) for threads in (1, 2, 2)]
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-12 * abs(found[0]).max())
    # The same number of threads shares the work in the same way.
    np.testing.assert_array_equal(found[2], found[1])


def test_solutions_equal_those_of_superlu():
    A = shuffled(lattice(9, 8, 7))
    b = np.random.default_rng(1).standard_normal((A.shape[0], 4))
    expected = spla.splu(A).solve(b)
    np.testing.assert_allclose(
        CholeskyFactor(A, threads=2).solve(b), expected, rtol=0, atol=1e-11 * abs(expected).max()
    )


def test_pivots_equal_those_of_dense_algebra_in_the_same_order():
    A = sp.csc_array(CUBE[:400][:, :400])
    factor = CholeskyFactor(A)
    assert sorted(factor.order) == list(range(400))
    L = np.linalg.cholesky(A.toarray()[np.ix_(factor.order, factor.order)])
    np.testing.assert_allclose(factor.pivots[factor.order], L.diagonal() ** 2, rtol=1e-10)


def test_the_size_follows_from_the_pattern_and_is_passed_before_the_factorisation():
    order, seen = nested_dissection(CUBE), []
    factor = CholeskyFactor(CUBE, order, admit=seen.append)
    least = factor_entries(CUBE, order)
    assert seen == [factor.size] and least <= factor.size.entries < 1.15 * least
    assert factor.size.bytes > 8 * factor.size.entries
    # The sum of squares of the columns' lengths is smallest if all lengths are equal.
    assert factor.size.operations > factor.size.entries**2 / CUBE.shape[0]


def test_a_factor_that_is_too_large_is_refused_before_allocation(monkeypatch):
    def refuse(size: FactorSize) -> None:
        raise MemoryError(f"{size.bytes:.0f} bytes")

    monkeypatch.setattr(CholeskyFactor, "_factorise", None)
    with pytest.raises(MemoryError, match="bytes"):
        CholeskyFactor(CUBE, admit=refuse)


def test_an_entry_in_one_triangle_alone_is_accepted():
    """Assembly leaves entries that cancel in one triangle and not in the other."""
    A = CUBE.tolil()
    A[5, CUBE.shape[0] - 1] = 1e-18
    A = sp.csc_array(A)
    b = random(2)
    assert backward_error(A, CholeskyFactor(A).solve(b), b) < 50 * EPS


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("row", [0, 1700, CUBE.shape[0] - 1])
def test_an_indefinite_matrix_is_refused_with_its_row(threads, row):
    A = CUBE.copy()
    A[row, row] *= -1
    with pytest.raises(NotPositiveDefiniteError) as caught:
        CholeskyFactor(A, threads=threads)
    # The pivot that fails belongs to the row or to one that is eliminated later.
    place = np.argsort(cube_factor(threads).order)
    assert place[caught.value.row] >= place[row]


def test_single_precision_gives_seven_digits_and_takes_half_the_memory():
    scale = 2.0 ** -np.round(np.log2(CUBE.diagonal()) / 2)
    x = random(5) * [1e-60, 1.0, 1e60, 0.0, 3.0]
    single, double = CholeskyFactor(CUBE, scale=scale, threads=2), cube_factor(2)
    found = single.solve(CUBE @ x)
    assert (abs(found - x).max(axis=0) <= 1e-4 * abs(x).max(axis=0)).all()
    np.testing.assert_allclose(single.pivots[single.order], double.pivots[double.order], rtol=1e-4)
    assert 0.45 * double.size.bytes < single.size.bytes < 0.6 * double.size.bytes


def test_a_missing_package_is_named(monkeypatch):
    package.lacks.cache_clear()
    assert package.lacks() == ""
    monkeypatch.setattr(package, "dissection_installed", lambda: False)
    package.lacks.cache_clear()
    assert "pip install pymetis" in package.lacks()
    package.lacks.cache_clear()


def test_the_package_imports_nothing_of_the_rest_and_numba_only_for_a_factor():
    look = (
        "import sys, cmsreduce.multifrontal as package; early = 'numba' in sys.modules; package.CholeskyFactor; "
        "print(early, [name for name in sys.modules if name.startswith('cmsreduce.')"
        " and not name.startswith('cmsreduce.multifrontal')])"
    )
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert said.stdout.split() == ["False", "[]"]
