"""Orders from the other end, in which rigid motion costs no force either: of chains of rows, and of whole solids."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import unchanged_in
from cmsreduce.model import FEModel, Nodes
from cmsreduce.read.row_order.held_body import beside_supports, supports_of
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
    rows, chain = _chains(body, kind)
    if not rows.size:
        return NONE_HIDDEN
    least, first = max(_SAME, _ROUNDINGS * body.rounding), np.searchsorted(chain, chain)
    # Position of the row in whose place each one is in reverse.
    back = first + np.searchsorted(chain, chain, side="right") - 1 - np.arange(rows.size)
    differ = np.logical_or(*(_changed(A, rows, chain, back, least) for A in (body.K, body.M)))
    kept = np.isin(chain, np.flatnonzero(differ & ~_end_at_supports(body, nodes, rows, chain, back, least)))
    hidden = np.sort(rows[kept])
    return hidden_rows(body, hidden, _CHAIN, turning=bool((body.dofs.component[hidden] > 3).any()))


def _chains(body: FEModel, kind: Indices) -> tuple[Indices, Indices]:
    """Rows (k,) of all chains, from end to end, one chain after the other, and the number of the chain of each."""
    # Imported here: it loads libraries that other proofs do not need.
    from scipy.sparse.csgraph import breadth_first_order, connected_components

    own, K = np.sqrt(abs(body.K.diagonal())), sp.coo_array(body.K)
    firm = (K.row != K.col) & (abs(K.data) > max(COUPLED, DIGITS * body.rounding) * own[K.row] * own[K.col])
    links = np.stack([K.row[firm], K.col[firm]])
    graph = sp.csr_array((np.ones(links.shape[1], np.int32), tuple(links)), shape=K.shape)
    degree = np.diff(graph.indptr)
    count, part = connected_components(graph, directed=False)
    size = np.bincount(part)
    low, high, most = np.full(count, body.n), np.full(count, -1), np.zeros(count, dtype=np.int64)
    np.minimum.at(low, part, kind)
    np.maximum.at(high, part, kind)
    np.maximum.at(most, part, degree)
    two = np.bincount(part, degree == 1, count) == 2
    found = (size >= _FEWEST) & (low == high) & (low >= 0) & (most == 2) & two
    ends = np.flatnonzero(found[part] & (degree == 1))
    if not ends.size:
        return ends, ends
    ends = ends[np.argsort(part[ends], kind="stable")]
    # The end of each is joined to the start of the next: one walk passes through all.
    links = np.hstack([links, np.stack([ends[1:-1:2], ends[2::2]])])
    graph = sp.csr_array((np.ones(links.shape[1], np.int32), tuple(links)), shape=K.shape)
    rows = breadth_first_order(graph, ends[0], directed=False, return_predecessors=False).astype(np.int64)
    return rows, np.asarray(np.unique(part[rows], return_inverse=True)[1], dtype=np.int64)


def _inside(A: sp.csc_array, rows: Indices, chain: Indices) -> tuple[sp.csc_array, Indices, Flags]:
    """Columns of chains, the position of the column of each entry, and whether its row is of the same chain."""
    of, columns = np.full(A.shape[0], -1), sp.csc_array(A[:, rows])
    of[rows] = chain
    at = np.repeat(np.arange(rows.size), np.diff(columns.indptr))
    return columns, at, of[columns.indices] == chain[at]


def _changed(A: sp.csc_array, rows: Indices, chain: Indices, back: Indices, least: float) -> Flags:
    """Chains (c,) that change a symmetric matrix if they alone are in reverse, by a product with random numbers."""
    columns, at, inside = _inside(A, rows, chain)
    own, order = np.sqrt(abs(A.diagonal())), np.arange(A.shape[0])
    order[rows] = rows[back]
    size = np.maximum(own, own[order])
    z = np.random.default_rng(1).uniform(1.0, 2.0, own.size)
    alone, turned = (np.divide(z, each, out=z.copy(), where=each > 0) for each in (own, size))
    rest, there = columns.data * np.where(inside, 0.0, alone[columns.indices]), columns.data * inside
    found = np.bincount(at, rest + there * turned[columns.indices], rows.size)
    other = np.bincount(at, rest + there * turned[order][columns.indices], rows.size)[back]
    return np.bincount(chain, abs(other - found) > least * size[rows]) > 0


def _end_at_supports(body: FEModel, nodes: Nodes, rows: Indices, chain: Indices, back: Indices, least: float) -> Flags:
    """True for chains (c,) whose rows that the ground holds are beside supports, and those in their place not.

    All rows of a chain move by one under one rigid motion.
    """
    columns, at, inside = _inside(body.K, rows, chain)
    force = np.bincount(at[inside], columns.data[inside], rows.size)
    loud = np.flatnonzero(abs(force) > least * body.K.diagonal()[rows])
    sound, component = np.bincount(chain[loud], minlength=chain[-1] + 1) > 0, body.dofs.component[rows]
    for one in np.unique(component[loud]):
        held = loud[component[loud] == one]
        supports = supports_of(body, nodes, one)
        ids, of = np.unique(body.dofs.node[rows[np.concatenate([held, back[held]])]], return_inverse=True)
        here, there = np.split(beside_supports(body, nodes, ids, body.K, supports)[of], 2)
        sound[chain[held[~here | there]]] = False
    return np.asarray(sound)


def prove_image(body: FEModel, nodes: Nodes) -> HiddenRows:
    """Look whether nodes in the place of their images about their middle make another body, as those of solids may."""
    if ((body.dofs.component < 1) | (body.dofs.component > 3)).any():
        return NONE_HIDDEN
    ids, of = np.unique(body.dofs.node, return_inverse=True)
    if (to := mirror_image(nodes.xyz[nodes.index(ids)], -np.ones(3))) is None:
        return NONE_HIDDEN
    others = body.dofs.rows(ids[to][of], body.dofs.component)
    least = max(_SAME, _ROUNDINGS * body.rounding)
    if (others < 0).any() or all(unchanged_in(A, others, least) for A in (body.K, body.M)):
        return NONE_HIDDEN
    force, supports = abs(body.K @ body.rigid_shapes[:, :3]).max(axis=1), supports_of(body, nodes, (1, 2, 3))
    loud = np.unique(of[force > least * body.K.diagonal()])
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
