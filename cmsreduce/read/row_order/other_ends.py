"""Orders from the other end, in which rigid motion costs no force either: of chains of rows, and of whole solids."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.linalg.blocks import unchanged_in
from cmsreduce.model import FEModel, Nodes
from cmsreduce.read.row_order.held_body import beside_supports
from cmsreduce.read.row_order.mass_order import COUPLED, DIGITS
from cmsreduce.read.row_order.row_order_proof import NONE_HIDDEN, HiddenRows, hidden_rows

__all__ = ["mirror_image", "prove_chains", "prove_image"]

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Relative to both diagonals, and in roundings of the file: entries that are the same.
_SAME, _ROUNDINGS = 1e-6, 1e3
# Rows of a chain whose ends differ.
_FEWEST = 3
# Distance of nodes at one place, relative to the size of the body.
_ONE_PLACE = 1e-5
_CHAIN = (
    "are chains that share no stiffness with other rows: in reverse they cost no force under rigid motion either, and "
    "make another body"
)
_IMAGE = (
    "the nodes are their own mirror image about their middle, and have translations alone: in the place of their "
    "images they cost no force under rigid motion either, and make another body"
)


def prove_chains(body: FEModel, nodes: Nodes, kind: Indices) -> HiddenRows:
    """Find chains of rows that couple no others, apart from those that are the same in reverse.

    Parameters
    ----------
    body : FEModel
        n dofs.
    nodes : Nodes
        Its geometry.
    kind : (n,) int64
        Number that rows share which every rigid motion moves the same; -1 for others.
    """
    # Imported here: it loads libraries that other proofs do not need.
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    own, K = np.sqrt(abs(body.K.diagonal())), sp.coo_array(body.K)
    firm = (K.row != K.col) & (abs(K.data) > max(COUPLED, DIGITS * body.rounding) * own[K.row] * own[K.col])
    graph = sp.csr_array((np.ones(firm.sum(), np.int32), (K.row[firm], K.col[firm])), shape=K.shape)
    degree = np.diff(graph.indptr)
    count, part = connected_components(graph, directed=False)
    size = np.bincount(part)
    low, high, most = np.full(count, body.n), np.full(count, -1), np.zeros(count, dtype=np.int64)
    np.minimum.at(low, part, kind)
    np.maximum.at(high, part, kind)
    np.maximum.at(most, part, degree)
    ends = np.bincount(part, degree == 1, count)
    hidden = []
    for number in np.flatnonzero((size >= _FEWEST) & (low == high) & (low >= 0) & (most == 2) & (ends == 2)):
        start = np.flatnonzero((part == number) & (degree == 1))[0]
        chain = np.asarray(breadth_first_order(graph, start, directed=False)[0], dtype=np.int64)
        if not _same(body, chain, chain[::-1]) and not _ends_at_supports(body, nodes, chain):
            hidden.append(chain)
    if not hidden:
        return NONE_HIDDEN
    rows = np.sort(np.concatenate(hidden)).astype(np.int64)
    return hidden_rows(body, rows, _CHAIN, turning=bool((body.dofs.component[rows] > 3).any()))


def _same(body: FEModel, rows: Indices, others: Indices) -> bool:
    """True if rows in each other's place leave both matrices as they are."""
    least = max(_SAME, _ROUNDINGS * body.rounding)
    return all(unchanged_in(A, rows, others, least) for A in (body.K, body.M))


def _supports(body: FEModel, nodes: Nodes, components: ArrayLike) -> Indices:
    """Positions of nodes that are held in one of some components."""
    if body.constrained is None:
        return np.zeros(0, dtype=np.int64)
    at = nodes.index(body.constrained.node[np.isin(body.constrained.component, components)])
    return np.asarray(at[at >= 0])


def _ends_at_supports(body: FEModel, nodes: Nodes, chain: Indices) -> bool:
    """True if the rows of a chain that the ground holds are beside supports, and those in their place in reverse not.

    All of its rows move by one under one rigid motion.
    """
    if not (supports := _supports(body, nodes, body.dofs.component[chain[:1]])).size:
        return False
    force = np.asarray(body.K[chain][:, chain].sum(axis=1)).ravel()
    loud = abs(force) > max(_SAME, _ROUNDINGS * body.rounding) * body.K.diagonal()[chain]
    ids, of = np.unique(body.dofs.node[chain], return_inverse=True)
    beside = beside_supports(body, nodes, ids, body.K, supports)[of]
    return bool(loud.any() and beside[loud].all() and not beside[loud[::-1]].any())


def prove_image(body: FEModel, nodes: Nodes) -> HiddenRows:
    """Look whether nodes in the place of their images about their middle make another body, as those of solids may."""
    if ((body.dofs.component < 1) | (body.dofs.component > 3)).any():
        return NONE_HIDDEN
    ids, of = np.unique(body.dofs.node, return_inverse=True)
    if (to := mirror_image(nodes.xyz[nodes.index(ids)], -np.ones(3))) is None:
        return NONE_HIDDEN
    others = body.dofs.rows(ids[to][of], body.dofs.component)
    every = np.arange(body.n)
    if (others < 0).any() or _same(body, every, others):
        return NONE_HIDDEN
    force, supports = abs(body.K @ body.rigid_shapes[:, :3]).max(axis=1), _supports(body, nodes, (1, 2, 3))
    loud = np.unique(of[force > max(_SAME, _ROUNDINGS * body.rounding) * body.K.diagonal()])
    if loud.size and supports.size and not beside_supports(body, nodes, ids[np.sort(to[loud])], body.K, supports).any():
        # The images of nodes beside supports are not.
        return NONE_HIDDEN
    return HiddenRows(total=body.n, remark=_IMAGE, mirrored=True)


def mirror_image(xyz: NDArray[np.float64], signs: NDArray[np.float64]) -> Indices | None:
    """Number (N,) of the node at the image of each, by signs (3,) of coordinates about the middle; None without one.

    Examples
    --------
    >>> mirror_image(np.array([[0, 0, 0], [1.0, 0, 0], [0, 2, 0], [1, 2, 0]]), np.array([-1.0, 1, 1])).tolist()
    [1, 0, 3, 2]
    """
    x = xyz - (xyz.min(axis=0) + xyz.max(axis=0)) / 2
    both, same = np.vstack([x, x * signs]), _ONE_PLACE * float(abs(x).max())
    key = np.zeros(len(both), dtype=np.int64)
    for axis in range(3):
        order = np.argsort(both[:, axis], kind="stable")
        place = np.empty_like(key)
        place[order] = np.cumsum(np.diff(both[order, axis], prepend=both[order[0], axis]) > same)
        # Numbers that are in use alone, so that they stay small.
        key = np.unique(key * len(both) + place, return_inverse=True)[1]
    at = np.full(int(key.max()) + 1, -1)
    at[key[: len(x)]] = np.arange(len(x))
    to = at[key[len(x) :]]
    return None if (to < 0).any() or np.unique(to).size < len(x) else np.asarray(to)
