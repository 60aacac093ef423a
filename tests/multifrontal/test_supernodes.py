"""Supernodes of a factor, compared with its pattern from elimination of the graph."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.multifrontal import CholeskyFactor, nested_dissection
from cmsreduce.multifrontal.elimination import column_counts, couplings, elimination_tree, postorder
from cmsreduce.multifrontal.supernodes import shares, supernodes
from tests.multifrontal.matrices import backward_error, lattice


def random_pattern(n: int, density: float, seed: int) -> sp.csc_array:
    rng = np.random.default_rng(seed)
    A = sp.csc_array(sp.random_array((n, n), density=density, rng=rng))
    A = sp.csc_array(A + A.T + sp.eye_array(n))
    A.sort_indices()
    return A


MATRICES = {
    "empty": random_pattern(7, 0.0, 0),
    "one row": random_pattern(1, 0.0, 0),
    "sparse": random_pattern(90, 0.01, 1),
    "less sparse": random_pattern(60, 0.04, 2),
    "full": random_pattern(20, 1.0, 3),
    "solid": lattice(5, 4, 4),
    "plate": lattice(7, 6, dofs=6),
    "mast": lattice(60, dofs=6),
}


def eliminated(A: sp.csc_array, order: np.ndarray) -> np.ndarray:
    """Pattern of the Cholesky factor of A in an order (n, n): columns are eliminated one by one."""
    L = A[order][:, order].toarray() != 0
    for j in range(L.shape[0]):
        rows = np.flatnonzero(L[j + 1 :, j]) + j + 1
        L[np.ix_(rows, rows)] = True
    return np.tril(L)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", MATRICES)
def test_the_tree_and_the_counts_are_those_of_the_factor(name, seed):
    A = MATRICES[name]
    order = np.random.default_rng(seed).permutation(A.shape[0])
    pattern, place = couplings(A), np.argsort(order)
    tree = elimination_tree(*pattern, order, place)
    L = eliminated(A, order)
    below = [np.flatnonzero(column) for column in (L & ~np.eye(L.shape[0], dtype=bool)).T]
    assert tree.tolist() == [int(rows[0]) if rows.size else -1 for rows in below]
    post = postorder(tree)
    order = order[post]
    place = np.argsort(order)
    tree = elimination_tree(*pattern, order, place)
    assert (tree[tree >= 0] > np.flatnonzero(tree >= 0)).all()
    np.testing.assert_array_equal(column_counts(*pattern, order, place, tree), eliminated(A, order).sum(axis=0))


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("name", MATRICES)
def test_supernodes_hold_the_factor(name, threads):
    A = MATRICES[name]
    given = nested_dissection(A)
    found = supernodes(*couplings(A), given, threads)
    n, s = A.shape[0], found.parent.size
    assert sorted(found.order) == list(range(n)) and found.first[0] == 0 and found.first[-1] == n
    held = np.zeros((n, n), dtype=bool)
    for k in range(s):
        columns = np.arange(found.first[k], found.first[k + 1])
        rows = found.rows[found.begin[k] : found.begin[k + 1]]
        assert (np.diff(rows) > 0).all() and (rows > columns[-1]).all()
        held[np.ix_(np.r_[columns, rows], columns)] = True
        # Its update goes to the supernode of its first row.
        owner = int(np.searchsorted(found.first, rows[0], side="right")) - 1 if rows.size else -1
        assert found.parent[k] == owner
        if owner >= 0:
            theirs = np.arange(found.first[owner], found.first[owner + 1])
            assert np.isin(rows, np.r_[theirs, found.rows[found.begin[owner] : found.begin[owner + 1]]]).all()
    L = eliminated(A, found.order)
    assert not (L & ~held).any()
    assert found.nnz == np.tril(held).sum()
    # Small blocks are padded, and nothing else is.
    assert L.sum() == eliminated(A, given).sum()
    assert found.nnz <= L.sum() + 8 * 16 * n
    counts = np.diff(found.begin)[np.repeat(np.arange(s), np.diff(found.first))]
    within = np.concatenate([np.arange(c, 0, -1) for c in np.diff(found.first)])
    exact = ((counts + within) ** 2).sum()
    assert 0.5 * exact - n <= found.operations.sum() <= exact
    # Subtrees share only rows above all subtrees.
    top = found.first[found.above.start]
    for number in range(found.subtrees.size - 1):
        part = found.subtree(number)
        rows = found.rows[found.begin[part.start] : found.begin[part.stop]]
        assert ((rows < found.first[part.stop]) | (rows >= top)).all()


def test_large_blocks_have_little_padding():
    """Half of the factor of a plate lies in small blocks, which may have a third of zeros."""
    line = sp.diags_array([np.ones(99), np.ones(100), np.ones(99)], offsets=[-1, 0, 1])
    A = sp.csc_array(sp.kron(sp.kron(line, line), np.ones((3, 3))))
    order = nested_dissection(A)
    pattern = couplings(A)
    tree = elimination_tree(*pattern, order, np.argsort(order))
    order = order[postorder(tree)]
    place = np.argsort(order)
    entries = column_counts(*pattern, order, place, elimination_tree(*pattern, order, place)).sum()
    found = supernodes(*pattern, order)
    assert entries < found.nnz < 1.3 * entries
    assert found.parent.size < A.shape[0] / 10


def test_stored_zeros_do_not_couple_and_an_entry_in_one_triangle_does():
    entries = [(0, 0, 1.0), (1, 0, 0.0), (2, 0, 1.0), (1, 1, 1.0), (2, 1, 1e-17), (3, 3, 1.0), (0, 1, 0.0), (2, 2, 1.0)]
    row, column, value = (np.array(part) for part in zip(*entries, strict=True))
    A = sp.csc_array((value, (row, column)))
    starts, indices = couplings(A)
    found = [sorted(set(indices[starts[k] : starts[k + 1]].tolist())) for k in range(4)]
    assert found == [[2], [2], [0, 1], []]


def test_a_factor_in_use_lends_its_supernodes_to_the_same_pattern_only():
    A, other = lattice(5, 4, 4), lattice(5, 4, 4)
    # The same number of entries, one pair at another place.
    gone, new = (3, 0), (239, 0)
    assert other[*gone] and not other[*new]
    other = other.tolil()
    for i, j in (gone, gone[::-1]):
        other[i, j] = 0.0
    for i, j in (new, new[::-1]):
        other[i, j] = -1.0
    other, order = sp.csc_array(other), nested_dissection(A)
    shift = sp.csc_array(A + sp.eye_array(A.shape[0]))
    first = CholeskyFactor(A, order, threads=2)
    rest = {name: CholeskyFactor(B, order, threads=2) for name, B in {"shift": shift, "other": other}.items()}
    assert rest["shift"]._tree is first._tree
    for tree in (rest["other"]._tree, CholeskyFactor(A, order)._tree, CholeskyFactor(A, order[::-1], threads=2)._tree):
        assert tree is not first._tree
    b = np.random.default_rng(1).standard_normal((A.shape[0], 2))
    assert backward_error(shift, rest["shift"].solve(b), b) < 1e-14
    assert backward_error(other, rest["other"].solve(b), b) < 1e-14


@pytest.mark.parametrize("threads", [1, 2, 3, 8])
def test_work_is_shared_evenly(threads):
    cost = np.random.default_rng(5).uniform(0, 1, 40).tolist()
    found, most = shares(cost, threads)
    assert sorted(piece for share in found for piece in share) == list(range(40))
    assert most == pytest.approx(max(sum(cost[piece] for piece in share) for share in found))
    assert most <= sum(cost) / threads + max(cost)
