"""Matrices for the tests of the solver, and measures of its factors and solutions."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.multifrontal.elimination import column_counts, couplings, elimination_tree, postorder

__all__ = ["backward_error", "coupled", "factor_entries", "lattice", "shuffled", "sparse_definite"]


def coupled(graph: sp.sparray, dofs: int = 3) -> sp.csc_array:
    """Positive definite matrix of nodes with several dofs: all dofs of coupled nodes couple, and no entry cancels."""
    graph = sp.coo_array(graph)
    # Products of kron store zeros.
    graph.eliminate_zeros()
    graph.data[:] = 1.0
    coupling = sp.kron(graph, np.ones((dofs, dofs)))
    return sp.csc_array(sp.diags_array(coupling.sum(axis=0) + 1.0) - coupling)


def lattice(*nodes: int, dofs: int = 3) -> sp.csc_array:
    """Box of nodes; each node couples with those of the cells around it, as in a mesh of bricks."""
    graph = sp.csc_array([[1.0]])
    for count in nodes:
        line = sp.diags_array([np.ones(count - 1), np.ones(count), np.ones(count - 1)], offsets=[-1, 0, 1])
        graph = sp.kron(graph, line)
    return coupled(graph, dofs)


def sparse_definite(nodes: int, density: float, seed: int) -> sp.csc_array:
    """Nodes of three rows with random couplings."""
    graph = sp.random_array((nodes, nodes), density=density, rng=np.random.default_rng(seed))
    return coupled(graph + graph.T + sp.eye_array(nodes))


def shuffled(A: sp.csc_array, seed: int = 0) -> sp.csc_array:
    order = np.random.default_rng(seed).permutation(A.shape[0])
    return sp.csc_array(A[order][:, order])


def factor_entries(A: sp.csc_array, order: np.ndarray) -> int:
    """Entries of the Cholesky factor of a matrix in an order."""
    pattern = couplings(sp.csc_array(A))
    order = order[postorder(elimination_tree(*pattern, order, np.argsort(order)))]
    place = np.argsort(order)
    return int(column_counts(*pattern, order, place, elimination_tree(*pattern, order, place)).sum())


def backward_error(A: sp.csc_array, x: np.ndarray, b: np.ndarray) -> float:
    """Largest residual of a row over the sum of its absolute terms."""
    return float((abs(A @ x - b) / (abs(A) @ abs(x) + abs(b))).max())
