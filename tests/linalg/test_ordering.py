"""Fill-reducing order against orders and groups that are known."""

import pickle

import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.linalg import ordering
from cmsreduce.linalg.ordering import KnownOrders, nested_dissection, row_groups
from cmsreduce.linalg.symbolic import factor_cost
from tests.frames import frame
from tests.linalg.test_symbolic import solid, sparse_definite
from tests.solids import block


def shuffled(A: sp.csc_array, seed: int = 0) -> sp.csc_array:
    order = np.random.default_rng(seed).permutation(A.shape[0])
    return sp.csc_array(A[order][:, order])


def like_rows(A: sp.csc_array) -> set[frozenset[int]]:
    """Groups of rows whose stored entries and diagonals stand in the same columns."""
    groups: dict[bytes, set[int]] = {}
    stored = sp.csc_array((np.ones(A.nnz), A.indices, A.indptr), A.shape).toarray() + np.eye(A.shape[0]) != 0
    for row, pattern in enumerate(stored):
        groups.setdefault(pattern.tobytes(), set()).add(row)
    return {frozenset(rows) for rows in groups.values()}


def as_sets(group: np.ndarray) -> set[frozenset[int]]:
    return {frozenset(np.flatnonzero(group == g).tolist()) for g in np.unique(group)}


SQUARE = frame("square", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.3]], [(1, 2), (2, 3), (3, 4), (4, 1)]).K
PATTERNS = {
    "solid": block("solid", (3, 1, 1), (4, 2, 2)).K,
    "frame": SQUARE,
    "shuffled nodes": shuffled(sparse_definite(40, 0.05, 1)),
    "single rows": shuffled(sp.csc_array(sp.diags_array([np.ones(29), np.ones(30), np.ones(29)], offsets=[-1, 0, 1]))),
    "diagonal": sp.csc_array(sp.eye_array(7)),
    "full": sp.csc_array(np.ones((7, 7))),
    "no diagonal": sp.csc_array(np.array([[0.0, 1.0, 1.0], [1.0, 0.0, 1.0], [1.0, 1.0, 0.0]])),
    "one row": sp.csc_array([[2.0]]),
    "nothing": sp.csc_array((0, 0)),
}


@pytest.mark.parametrize("A", PATTERNS.values(), ids=PATTERNS)
def test_groups_are_the_rows_of_like_entries(A):
    assert as_sets(row_groups(A)) == like_rows(A)


def test_groups_are_numbered_by_their_first_rows():
    A = sp.csc_array(sp.kron(solid(2), np.ones((2, 2))))
    np.testing.assert_array_equal(row_groups(A), np.repeat(np.arange(27), 6))


def test_rows_that_agree_by_chance_are_not_merged(monkeypatch):
    class Constant:
        def integers(self, low, high, size, dtype):
            return np.ones(size, dtype)

    # Every key the same: all rows with as many entries look alike.
    monkeypatch.setattr(ordering.np.random, "default_rng", lambda seed: Constant())
    A = PATTERNS["shuffled nodes"]
    true = like_rows(A)
    for rows in as_sets(row_groups(A)):
        assert any(rows <= group for group in true)


@pytest.mark.parametrize("A", PATTERNS.values(), ids=PATTERNS)
def test_every_row_has_one_place_beside_its_like(A):
    order = nested_dissection(A)
    np.testing.assert_array_equal(np.sort(order), np.arange(A.shape[0]))
    place = np.argsort(order)
    for rows in like_rows(A):
        assert np.ptp(place[list(rows)]) == len(rows) - 1


def test_the_order_is_the_same_every_time():
    A = solid(6)
    np.testing.assert_array_equal(nested_dissection(A), nested_dissection(A.copy()))


def test_entries_need_not_be_sorted_and_stay_as_they_are():
    order = np.random.default_rng(3).permutation(81)
    A = solid(2)[order][:, order]
    assert not A.has_sorted_indices
    before = A.indices.copy(), A.toarray()
    nested = nested_dissection(A)
    np.testing.assert_array_equal(A.indices, before[0])
    np.testing.assert_array_equal(A.toarray(), before[1])
    A.sort_indices()
    np.testing.assert_array_equal(nested_dissection(A), nested)


def test_a_solid_fills_less_than_by_minimum_degree():
    A = solid(14)
    assert 10_000 < A.shape[0] < 10_500
    lu = spla.splu(A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    assert factor_cost(A, nested_dissection(A)).nnz < 0.95 * lu.nnz / 2


def test_parts_are_ordered_apart():
    parts = [solid(6), solid(4), sp.eye_array(5)]
    whole = shuffled(sp.csc_array(sp.block_diag(parts)))
    alone = sum(factor_cost(part, nested_dissection(part)).nnz for part in map(sp.csc_array, parts))
    # The cuts of METIS differ with the rest of the graph, by a tenth here; parts that touched would fill far more.
    assert factor_cost(whole, nested_dissection(whole)).nnz < 1.2 * alone


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
    assert factor_cost(A, order).nnz < 5 * n


def test_an_order_is_known_again_by_its_pattern_alone():
    known, A = KnownOrders(), sparse_definite(10, 0.2, 0)
    other = shuffled(A)
    known.keep(A.indptr, A.indices, np.arange(A.shape[0]))
    np.testing.assert_array_equal(known.of(A.indptr.copy(), A.indices.copy()), np.arange(A.shape[0]))
    assert known.of(other.indptr, other.indices) is None
    assert pickle.loads(pickle.dumps(known)).of(A.indptr, A.indices) is None
    for n in range(40, 48):
        known.keep(np.arange(n + 1), np.arange(n), np.arange(n))
    assert known.of(A.indptr, A.indices) is None
    assert known.of(np.arange(48), np.arange(47)) is not None
