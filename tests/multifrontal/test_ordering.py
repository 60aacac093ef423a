"""Fill-reducing orders, compared with known orders and groups."""

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.multifrontal import nested_dissection, ordering, row_groups
from tests.multifrontal.matrices import coupled, factor_entries, lattice, shuffled, sparse_definite


def like_rows(A: sp.csc_array) -> set[frozenset[int]]:
    """Groups of rows whose stored entries and diagonals are in the same columns."""
    groups: dict[bytes, set[int]] = {}
    stored = sp.csc_array((np.ones(A.nnz), A.indices, A.indptr), A.shape).toarray() + np.eye(A.shape[0]) != 0
    for row, pattern in enumerate(stored):
        groups.setdefault(pattern.tobytes(), set()).add(row)
    return {frozenset(rows) for rows in groups.values()}


def as_sets(group: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(group == g).tolist()) for g in np.unique(group)}


RING = sp.diags_array([np.ones(1), np.ones(5), np.ones(6), np.ones(5), np.ones(1)], offsets=[-5, -1, 0, 1, 5])
PATTERNS = {
    "solid": lattice(5, 3, 3),
    "frame": coupled(RING, 6),
    "shuffled nodes": shuffled(sparse_definite(40, 0.05, 1)),
    "single rows": shuffled(sp.csc_array(sp.diags_array([np.ones(29), np.ones(30), np.ones(29)], offsets=[-1, 0, 1]))),
    "diagonal": sp.csc_array(sp.eye_array(7)),
    "full": sp.csc_array(np.ones((7, 7))),
    "no diagonal": sp.csc_array(np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])),
    "one row": sp.csc_array([[2.0]]),
    "nothing": sp.csc_array((0, 0)),
}


@pytest.mark.parametrize("A", PATTERNS.values(), ids=PATTERNS)
def test_groups_are_the_rows_with_the_same_columns(A):
    assert as_sets(row_groups(A)) == like_rows(A)


def test_groups_are_numbered_by_their_first_rows():
    A = sp.csc_array(sp.kron(lattice(3, 3, 3), np.ones((2, 2))))
    np.testing.assert_array_equal(row_groups(A), np.repeat(np.arange(27), 6))


def test_rows_that_agree_by_chance_are_not_merged(monkeypatch):
    class Constant:
        def integers(self, low, high, size, dtype):
            return np.ones(size, dtype)

    # With equal keys all rows of as many entries have the same sum.
    monkeypatch.setattr(ordering.np.random, "default_rng", lambda seed: Constant())
    A = PATTERNS["shuffled nodes"]
    true = like_rows(A)
    for rows in as_sets(row_groups(A)):
        assert any(rows <= group for group in true)


@pytest.mark.parametrize("density", [0.005, 0.05])
def test_nodes_without_some_of_their_couplings_are_ordered_as_those_with_all(density):
    whole = lattice(7, 6, 5)
    rng = np.random.default_rng(5)
    left_out = sp.random_array(whole.shape, density=density, rng=rng) + sp.eye_array(whole.shape[0])
    fewer = sp.csc_array(whole * ((left_out + left_out.T).toarray() == 0) + sp.diags_array(whole.diagonal()))
    assert np.unique(row_groups(fewer)).size > 1.5 * 7 * 6 * 5
    np.testing.assert_array_equal(nested_dissection(fewer), nested_dissection(whole))


@pytest.mark.parametrize("A", PATTERNS.values(), ids=PATTERNS)
def test_every_row_has_one_place_beside_its_group(A):
    order = nested_dissection(A)
    np.testing.assert_array_equal(np.sort(order), np.arange(A.shape[0]))
    place = np.argsort(order)
    for rows in like_rows(A):
        assert np.ptp(place[list(rows)]) == len(rows) - 1


def test_the_order_is_the_same_every_time():
    A = lattice(7, 7, 7)
    np.testing.assert_array_equal(nested_dissection(A), nested_dissection(A.copy()))


def test_entries_need_not_be_sorted_and_do_not_change():
    order = np.random.default_rng(3).permutation(81)
    A = lattice(3, 3, 3)[order][:, order]
    assert not A.has_sorted_indices
    before = A.indices.copy(), A.toarray()
    nested = nested_dissection(A)
    np.testing.assert_array_equal(A.indices, before[0])
    np.testing.assert_array_equal(A.toarray(), before[1])
    A.sort_indices()
    np.testing.assert_array_equal(nested_dissection(A), nested)


def test_a_solid_fills_less_than_by_minimum_degree():
    A = lattice(15, 15, 15)
    assert 10_000 < A.shape[0] < 10_500
    lu = spla.splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    assert factor_entries(A, nested_dissection(A)) < 0.95 * lu.nnz / 2


def test_uncoupled_parts_are_ordered_separately():
    parts = [lattice(7, 7, 7), lattice(5, 5, 5), sp.eye_array(5)]
    whole = shuffled(sp.csc_array(sp.block_diag(parts)))
    alone = sum(factor_entries(part, nested_dissection(part)) for part in map(sp.csc_array, parts))
    # The cuts of METIS depend on the whole graph, by a tenth here; mixed parts would cause far more fill.
    assert factor_entries(whole, nested_dissection(whole)) < 1.2 * alone


def test_rows_that_couple_with_all_come_last():
    n, hubs = 4000, [17, 1234]
    chain = sp.lil_array(sp.diags_array([np.ones(n - 1), np.ones(n), np.ones(n - 1)], offsets=[-1, 0, 1]))
    for hub in hubs:
        chain[hub, :] = 1.0
        chain[:, hub] = 1.0
    A = sp.csc_array(chain)
    order = nested_dissection(A)
    assert set(order[-2:]) == set(hubs)
    # Each hub adds one entry to each column; a dissected chain has two or three.
    assert factor_entries(A, order) < 5 * n
