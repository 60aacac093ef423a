"""The null space of constraints, against that of another library and against its own definition."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.assemble.constraint_space import connected_rows, constraint_space
from cmsreduce.linalg.blocks import dense


def blocks(rng, sizes, rank_loss):
    """Groups of constraints over coordinates of their own, some rows sums of others, and free coordinates between."""
    parts = []
    for c, n in sizes:
        A = rng.standard_normal((c, n)) * 10.0 ** rng.uniform(-3, 3, (c, 1))
        if rank_loss and c > 1:
            A[-1] = A[:-1].sum(axis=0)
        parts.append(A)
    A = la.block_diag(*parts)
    return A[:, rng.permutation(A.shape[1])]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    sizes=st.lists(st.tuples(st.integers(1, 4), st.integers(1, 9)), min_size=1, max_size=5),
    free=st.integers(0, 60),
    rank_loss=st.booleans(),
    seed=st.integers(0, 10**6),
)
def test_any_constraints(sizes, free, rank_loss, seed):
    rng = np.random.default_rng(seed)
    A = np.hstack([blocks(rng, sizes, rank_loss), np.zeros((sum(c for c, _ in sizes), free))])
    space = constraint_space(sp.csr_array(A))
    T = dense(space.T)
    rows = A / np.linalg.norm(A, axis=1, keepdims=True)
    expected = la.null_space(rows, rcond=1e-9)
    assert T.shape == expected.shape
    np.testing.assert_allclose(T.T @ T, np.eye(T.shape[1]), atol=1e-14)
    np.testing.assert_allclose(rows @ T, 0, atol=1e-12)
    np.testing.assert_allclose(T @ T.T, expected @ expected.T, atol=1e-10)


@pytest.mark.parametrize("free", [0, 200], ids=["dense", "sparse"])
def test_a_projection_is_the_product_of_three_matrices(free):
    """Of a stiffness over twelve decades, to the rounding of its largest entry."""
    rng = np.random.default_rng(3)
    A = np.hstack([blocks(rng, [(3, 20), (6, 30)], True), np.zeros((9, free))])
    K = np.diag(10.0 ** rng.permutation(np.linspace(-4, 8, A.shape[1])))
    space = constraint_space(sp.csr_array(A))
    assert sp.issparse(space.T) == bool(free)
    found = space.congruent([K[:25, :25], sp.csc_array(K[25:, 25:])])
    T = dense(space.T)
    assert (dense(found) == dense(found).T).all()
    np.testing.assert_allclose(dense(found), T.T @ K @ T, rtol=0, atol=1e-15 * abs(K).max())


def test_no_constraints_leave_every_coordinate():
    np.testing.assert_array_equal(dense(constraint_space(sp.csr_array((0, 4))).T), np.eye(4))


def test_rows_are_grouped_by_the_columns_they_share():
    A = np.zeros((5, 6))
    A[0, [0, 1]] = A[1, [2, 3]] = A[2, [1, 4]] = A[4, 3] = 1.0
    groups = sorted(tuple(group) for group in connected_rows(A))
    assert groups == [(0, 2), (1, 4)]
