"""Predicted sizes of Cholesky factors, compared with the factors."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import factorise
from cmsreduce.linalg.sparse.factor_size import elimination_tree, factor_cost
from cmsreduce.linalg.sparse.superlu import SuperLU
from cmsreduce.multifrontal import nested_dissection


def sparse_definite(nodes: int, density: float, seed: int) -> sp.csc_array:
    """Nodes of three rows with negative couplings and a dominant diagonal: no entry of the factor cancels."""
    rng = np.random.default_rng(seed)
    graph = sp.random_array((nodes, nodes), density=density, rng=rng)
    coupling = sp.kron(graph + graph.T + sp.eye_array(nodes), np.ones((3, 3)))
    return sp.csc_array(sp.diags_array(coupling.sum(axis=0) + 1.0) - coupling)


def solid(cells: int) -> sp.csc_array:
    """Pattern of a cube of bricks, three rows a node, with values of a definite matrix."""
    line = sp.diags_array([np.ones(cells), np.ones(cells + 1), np.ones(cells)], offsets=[-1, 0, 1])
    coupling = sp.kron(sp.kron(sp.kron(line, line), line), np.ones((3, 3)))
    return sp.csc_array(sp.diags_array(coupling.sum(axis=0) + 1.0) - coupling)


def dense_factor(A: sp.csc_array, order: np.ndarray) -> np.ndarray:
    return np.linalg.cholesky(A.toarray()[np.ix_(order, order)])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("order", ["as given", "random", "dissected"])
@pytest.mark.parametrize(("nodes", "density"), [(1, 0.0), (2, 0.0), (8, 0.2), (40, 0.02), (60, 0.05)], ids=str)
def test_counts_are_those_of_the_dense_factor(nodes, density, order, seed):
    A = sparse_definite(nodes, density, seed)
    n = A.shape[0]
    sequence = {
        "as given": np.arange(n),
        "random": np.random.default_rng(seed).permutation(n),
        "dissected": nested_dissection(A),
    }[order]
    columns = np.count_nonzero(dense_factor(A, sequence), axis=0)
    cost = factor_cost(A, sequence, bytes_per_entry=12.0)
    assert (cost.nnz, cost.flops, cost.bytes) == (columns.sum(), (columns**2).sum(), 12.0 * columns.sum())


@pytest.mark.parametrize("seed", range(3))
def test_a_parent_is_the_first_entry_below_the_diagonal(seed):
    A = sparse_definite(30, 0.05, seed)
    n = A.shape[0]
    below = np.tril(dense_factor(A, np.arange(n)) != 0, -1)
    parent = np.where(below.any(axis=0), below.argmax(axis=0), n)
    graph = sp.csr_array(A - sp.diags_array(A.diagonal()))
    graph.eliminate_zeros()
    np.testing.assert_array_equal(elimination_tree(graph), parent)


N = 50


@pytest.mark.parametrize(
    ("pattern", "order", "nnz"),
    [
        (np.eye(N), np.arange(N), N),
        (np.tri(N, k=1) * np.tri(N, k=1).T, np.arange(N), 2 * N - 1),
        (np.ones((N, N)), np.arange(N), N * (N + 1) // 2),
        (np.eye(N) + np.eye(1, N).T, np.arange(N), N * (N + 1) // 2),
        (np.eye(N) + np.eye(1, N).T, np.arange(N)[::-1], 2 * N - 1),
        (np.zeros((0, 0)), np.arange(0), 0),
    ],
    ids=["diagonal", "chain", "full", "hub first", "hub last", "empty"],
)
def test_closed_forms(pattern, order, nnz):
    assert factor_cost(sp.csc_array(pattern + pattern.T), order).nnz == nnz


def test_zeros_on_the_diagonal_are_entries_of_the_factor():
    A = sparse_definite(20, 0.1, 0)
    hollow = sp.csc_array(A - sp.diags_array(A.diagonal()))
    hollow.eliminate_zeros()
    order = nested_dissection(A)
    assert factor_cost(hollow, order) == factor_cost(A, order)


def test_superlu_has_the_predicted_entries():
    A = solid(14)
    asked = []
    factor = SuperLU(A, True, asked.append)
    assert [factor.cost] == asked
    # SuperLU pads some columns to make blocks.
    assert factor.lu.nnz / 2 == pytest.approx(factor.cost.nnz, rel=2e-3)


@pytest.mark.pardiso
def test_pardiso_counts_about_the_same():
    A = solid(9)
    with solver_settings(SolverSettings("pardiso")):
        counted = factorise(A).cost
    cost = factor_cost(A, nested_dissection(A))
    # The two codes dissect the same graph differently.
    assert counted.nnz == pytest.approx(cost.nnz, rel=0.3)
    assert counted.flops == pytest.approx(cost.flops, rel=0.5)
