"""Sparse factors against dense algebra."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.factorise import BLOCK, NotPositiveDefiniteError, factorise
from tests.frames import frame, line


def banded(n: int, seed: int) -> sp.csc_array:
    rng = np.random.default_rng(seed)
    C = sp.random_array((n, n), density=4 / n, rng=rng, data_sampler=rng.standard_normal)
    return sp.csc_array(C @ C.T + sp.diags_array(rng.uniform(0.5, 2.0, n)))


@pytest.mark.parametrize("columns", [None, 1, BLOCK, BLOCK + 1, 3 * BLOCK], ids=str)
def test_solves_for_any_number_of_columns(columns):
    A = banded(150, 3)
    x = np.random.default_rng(0).standard_normal(150 if columns is None else (150, columns))
    np.testing.assert_allclose(factorise(A)(A @ x), x, rtol=0, atol=1e-11)


def test_pivots_multiply_to_the_determinant():
    A = banded(80, 4)
    factor = factorise(A)
    assert np.log(factor.pivots).sum() == pytest.approx(np.linalg.slogdet(A.toarray())[1], rel=1e-12)
    # The last dof eliminated keeps what is left when all others are free: 1 / (A^-1)_ii.
    inverse = np.linalg.inv(A.toarray()).diagonal()
    last = int(np.argmax(factor.lu.perm_c))
    assert factor.pivots[last] == pytest.approx(1 / inverse[last], rel=1e-11)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.93])
def test_negative_pivots_are_the_inertia(seed, share):
    A = banded(120, seed)
    lam = la.eigvalsh(A.toarray())
    below = int(share * lam.size)
    shift = (lam[below - 1] + lam[below]) / 2 if below else lam[0] / 2
    factor = factorise(sp.csc_array(A - shift * sp.eye_array(120)), definite=False)
    assert factor.negative_pivots == below


def pair() -> np.ndarray:
    """Rows 2 and 3 slide together; every diagonal entry of theirs is larger than row 0's."""
    A = np.diag([0.1, 2.0, 5.0, 5.0, 3.0])
    A[2, 3] = A[3, 2] = -5.0
    return A


def dangling() -> np.ndarray:
    """A clamped bar with a last node that only its axial stiffness holds: it swings across."""
    K = line("bar", [0, 0, 0], [1, 0, 0], 3, held=(1,)).K.toarray()
    n = K.shape[0]
    grown = np.zeros((n + 3, n + 3))
    grown[:n, :n] = K
    ends = [n - 6, n]
    grown[np.ix_(ends, ends)] += 1e7 * np.array([[1, -1], [-1, 1]])
    grown[n + 1, n + 1] = 3.0
    skew = np.array([1.0, -1.0])
    grown[np.ix_([n + 1, n + 2], [n + 1, n + 2])] = 3.0 * np.outer(skew, skew)
    return grown


@pytest.mark.parametrize(
    ("A", "rows"),
    [
        (pair(), {2, 3}),
        (np.diag([1.0, 0.0, 2.0]), {1}),
        (dangling(), {19, 20}),
        (np.diag([1.0, -1e-3, 2.0]), {1}),
    ],
    ids=["two rows slide together", "empty row", "a node swings", "negative"],
)
def test_what_is_not_held_is_named(A, rows):
    with pytest.raises(NotPositiveDefiniteError) as caught:
        factorise(sp.csc_array(A), what="the block")
    assert caught.value.row in rows
    assert str(caught.value).startswith("the block is ")


@pytest.mark.parametrize("seed", range(30))
def test_free_frames_are_singular_whatever_rounding_leaves(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 7))
    body = frame("free", rng.standard_normal((n, 3)), [(k, k + 1) for k in range(1, n)])
    with pytest.raises(NotPositiveDefiniteError):
        factorise(body.K)


def test_a_thousand_elements_in_a_row_are_held_by_one_clamp():
    body = line("mast", [0, 0, 0], [1, 0, 0], 1, held=(1,))
    h, n, EI = 1.0 / 1000, 1000, 2.0
    K = sp.lil_array((2 * n + 2, 2 * n + 2))
    k = EI / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]])
    k = np.vstack([k, -k[0], EI / h**3 * np.array([6 * h, 2 * h * h, -6 * h, 4 * h * h])])
    for e in range(n):
        K[2 * e : 2 * e + 4, 2 * e : 2 * e + 4] += k
    tip = np.zeros(2 * n)
    tip[-2] = 1.0
    deflection = factorise(sp.csc_array(K)[2:, 2:])(tip)[-2]
    # A condition number of 1e13 leaves three digits of L^3 / 3 EI.
    assert deflection == pytest.approx(1 / (3 * EI), rel=1e-3)
    assert body.n == 6


def test_inertia_is_not_read_from_permuted_rows():
    factor = factorise(sp.csc_array([[0.0, 1.0], [1.0, 0.0]]), definite=False)
    with pytest.raises(MatrixError, match="off the diagonal"):
        _ = factor.negative_pivots
