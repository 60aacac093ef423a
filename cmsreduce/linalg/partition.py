"""A body cut into parts by its graph: interiors that share no entry of a matrix, and the rows between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.multifrontal import compressed_graph, dissection_installed, row_groups

__all__ = ["Partition", "partition"]

# The parts must be the same in every run.
_SEED = 1


class Partition(NamedTuple):
    """Rows of a matrix in parts.

    Parameters
    ----------
    interiors : tuple of (n_p,) int64
        Rows of each part, ascending; no entry couples two parts.
    separator : (s,) int64
        The other rows, ascending: they hold the parts together.
    """

    interiors: tuple[NDArray[np.int64], ...]
    separator: NDArray[np.int64]


def partition(A: sp.csc_array, parts: int) -> Partition:
    """Cut the graph of a matrix into parts of about as many rows, with few rows between them.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; entries that are stored count, zeros too.
    parts : int
        How many; those that would be empty are left out.

    Returns
    -------
    Partition
        Dofs of a node that couple alike stay together.

    Raises
    ------
    MatrixError
        If METIS is not installed.

    Notes
    -----
    METIS cuts edges; of the two ends of those between two parts, the side with fewer rows goes to the separator.
    Source: G. Karypis, V. Kumar, "Multilevel k-way partitioning scheme for irregular graphs", J. Parallel Distrib.
    Comput. 48 (1998) 96-129.
    """
    if not dissection_installed():
        raise MatrixError("a body is cut into parts by METIS, which is not installed: pip install pymetis")
    import pymetis

    group = row_groups(A)
    graph, weight = compressed_graph(A, group)
    adjacency = pymetis.CSRAdjacency(graph.indptr, graph.indices)
    found = pymetis.part_graph(parts, adjacency, vweights=weight, options=pymetis.Options(seed=_SEED))[1]
    part = np.asarray(found, dtype=np.int64)
    part[_cover(graph, part, weight)] = parts
    of_row = part[group]
    interiors = (np.flatnonzero(of_row == p) for p in range(parts))
    return Partition(tuple(rows for rows in interiors if rows.size), np.flatnonzero(of_row == parts))


def _cover(graph: sp.csr_array, part: NDArray[np.int64], weight: NDArray[np.int64]) -> NDArray[np.int64]:
    """Vertices that every edge between two parts has at one of its ends."""
    one, other = (np.asarray(end, dtype=np.int64) for end in sp.coo_array(graph).coords)
    cut = part[one] < part[other]
    one, other = one[cut], other[cut]
    chosen = np.zeros(part.size, dtype=bool)
    pair = part[one] * (part.max(initial=0) + 1) + part[other]
    order = np.argsort(pair, kind="stable")
    one, other = one[order], other[order]
    for edges in np.split(np.arange(one.size), np.flatnonzero(np.diff(pair[order])) + 1):
        open_edges = edges[~(chosen[one[edges]] | chosen[other[edges]])]
        sides = np.unique(one[open_edges]), np.unique(other[open_edges])
        chosen[min(sides, key=lambda side: int(weight[side].sum()))] = True
    return np.flatnonzero(chosen)
