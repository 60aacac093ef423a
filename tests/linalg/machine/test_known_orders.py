"""Stored orders are found again by the pattern of a matrix alone."""

import itertools
import pickle

import numpy as np
import scipy.sparse as sp

from cmsreduce.linalg.machine import settings
from cmsreduce.linalg.machine.settings import KnownOrders
from cmsreduce.linalg.sparse.lower_triangle import lower_pattern, nonzero_pattern
from tests.multifrontal.matrices import shuffled, sparse_definite


def test_an_order_is_found_by_its_pattern_alone():
    known, A = KnownOrders(), sparse_definite(10, 0.2, 0)
    other = shuffled(A)
    known.store(A.indptr, A.indices, np.arange(A.shape[0]))
    np.testing.assert_array_equal(known.find(A.indptr.copy(), A.indices.copy()), np.arange(A.shape[0]))
    assert known.find(other.indptr, other.indices) is None
    assert pickle.loads(pickle.dumps(known)).find(A.indptr, A.indices) is None


def test_the_oldest_orders_are_dropped_beyond_a_size(monkeypatch):
    sizes, known = range(40, 48), KnownOrders()
    monkeypatch.setattr(settings, "_ORDERS", sum(np.arange(n).nbytes for n in sizes[1:]))
    for n in sizes:
        known.store(np.arange(n + 1), np.arange(n), np.arange(n))
    assert [n for n in sizes if known.find(np.arange(n + 1), np.arange(n)) is not None] == [*sizes[1:]]
    monkeypatch.setattr(settings, "_ORDERS", 1)
    known.store(np.arange(31), np.arange(30), np.arange(30))
    assert known.find(np.arange(31), np.arange(30)) is not None


def test_a_pattern_leaves_out_all_zeros_except_on_the_diagonal():
    entries = [(0, 0, 1.0), (1, 0, 0.0), (2, 0, 1.0), (1, 1, 1.0), (2, 1, 1e-17), (3, 3, 1.0), (0, 1, 0.0), (2, 2, 0.0)]
    row, column, value = (np.array(part) for part in zip(*entries, strict=True))
    starts, rows = lower_pattern(sp.csc_array((value, (row, column))))
    assert [rows[starts[k] : starts[k + 1]].tolist() for k in range(4)] == [[0, 2], [1, 2], [2], [3]]


def test_stored_zeros_and_the_order_of_entries_make_no_other_pattern():
    """K may store zeros that K - sigma M does not have."""
    A = sparse_definite(10, 0.2, 0)
    entries, (row, column) = sp.coo_array(A), np.argwhere(A.toarray() == 0)[:2].T
    places = tuple(np.concatenate([own, more]) for own, more in zip(entries.coords, (row, column), strict=True))
    stored = sp.csc_array(sp.coo_array((np.concatenate([entries.data, [0.0, 0.0]]), places), shape=A.shape))
    backward = np.concatenate([np.arange(a, b)[::-1] for a, b in itertools.pairwise(A.indptr)])
    turned = sp.csc_array((A.data[backward], A.indices[backward], A.indptr), shape=A.shape)
    assert stored.nnz == A.nnz + 2 and not turned.has_sorted_indices
    for other in (stored, turned):
        starts, rows = nonzero_pattern(other)
        np.testing.assert_array_equal(starts, A.indptr)
        np.testing.assert_array_equal(rows, A.indices)
    assert stored.nnz == A.nnz + 2
