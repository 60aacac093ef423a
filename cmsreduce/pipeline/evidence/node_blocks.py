"""Stiffness in blocks of two nodes, and its products with motions that each pair of nodes has for itself."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel

__all__ = ["AT_ONCE", "node_products", "stiffness_by_node", "sum_by_number"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

AT_ONCE = 20_000
"""Pairs of nodes whose entries are multiplied at once, so that they stay in the cache."""


def stiffness_by_node(body: FEModel, rows: Indices, at: Indices) -> sp.bsr_array:
    """Stiffness (6 N, 6 N) in blocks of two nodes along basic axes, of the rows of some nodes."""
    assert body.nodes is not None
    count = len(body.nodes)
    wanted = np.zeros(count, dtype=bool)
    wanted[at] = True
    own = np.full(body.n, -1)
    own[rows] = 6 * body.nodes.index(body.dofs.node[rows]) + body.dofs.component[rows] - 1
    rows = rows[wanted[own[rows] // 6]]
    rows = rows[np.argsort(own[rows], kind="stable")]
    # K is symmetric: its columns are its rows.
    K = body.K[:, rows]
    to = own[K.indices]
    if (to < 0).any():
        K = sp.csc_array((np.where(to < 0, 0.0, K.data), K.indices, K.indptr), shape=K.shape)
        to = np.maximum(to, 0)
    counts = np.zeros(6 * count, dtype=np.int64)
    counts[own[rows]] = np.diff(K.indptr)
    start = np.concatenate([[0], np.cumsum(counts)])
    found = sp.csr_array((K.data, to, start), shape=(6 * count, 6 * count)).tobsr((6, 6))
    found.sort_indices()
    F = body.nodes.frame
    if (np.eye(3) != F).any():
        row = np.repeat(np.arange(count), np.diff(found.indptr))
        blocks = found.data.reshape(-1, 2, 3, 2, 3)
        turned = np.einsum("bki,bpkql,blj->bpiqj", F[row], blocks, F[found.indices], optimize=True)
        found = sp.bsr_array((turned.reshape(-1, 6, 6), found.indices, found.indptr), shape=found.shape)
    return found


def node_products(A: sp.bsr_array, row: Indices, column: Indices, motion: Array) -> Array:
    """Blocks of A for pairs of nodes (p,), each times a motion (p, 6, c)."""
    found = np.zeros(motion.shape)
    count = A.shape[0] // 6
    keys = np.repeat(np.arange(count), np.diff(A.indptr)) * count + A.indices
    wanted = row * count + column
    at = np.minimum(np.searchsorted(keys, wanted), max(keys.size - 1, 0))
    there = np.flatnonzero(keys[at] == wanted) if keys.size else np.zeros(0, dtype=np.int64)
    for first in range(0, there.size, AT_ONCE):
        some = there[first : first + AT_ONCE]
        found[some] = A.data[at[some]] @ motion[some]
    return found


def sum_by_number(values: Array, of: Indices, count: int) -> Array:
    """Sums (count, ...) of values (p, ...) by their numbers."""
    adding = sp.csr_array((np.ones(of.size), (of, np.arange(of.size))), shape=(count, of.size))
    return np.asarray(adding @ values.reshape(of.size, math.prod(values.shape[1:]))).reshape(count, *values.shape[1:])
