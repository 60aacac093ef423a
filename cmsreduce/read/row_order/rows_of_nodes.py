"""Rows that rigid motions move alike, as one rotation of all nodes: what they couple shows of which node they are.

K R = 0 holds in any order of rows with the same row of R: one rotation of all nodes, and translations along one line.
An exchange of two of them couples nodes that no other rows of these nodes couple.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.machine import share_rows
from cmsreduce.model import FEModel, Nodes, rigid_body_shapes
from cmsreduce.read.row_order.mass_order import COUPLED, DIGITS
from cmsreduce.read.row_order.other_ends import prove_chains
from cmsreduce.read.row_order.row_order_proof import NONE_HIDDEN, HiddenRows, hidden_rows

__all__ = ["prove_rows_of_nodes"]

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

# Places and directions, relative to the size of the body, that rigid motions do not tell apart: in so many times the
# round-off of the forces, but within these bounds.
_ROUND_OFF, _NEAREST, _FARTHEST = 1e3, 1e-9, 1e-5
# More than the translations of a node.
_ALL = 9
# Share of rows that a matching of many may put back wrongly; none of a few.
_LEFT = 0.1
# Rows that are looked at for an exchange.
_MOST = 20_000
# Nodes beside nodes that are counted, for each entry and at least; rows with more are not shown.
_PAIRS, _FEWEST_PAIRS = 50, 1_000_000
# Rows that are exchanged couple nodes farther away, as those of a chain do, if the sum of distances grows by this.
_FARTHER = 1e-3
# Rows named in a message.
_NAMED = 5
# Rows whose entries are looked at together: temporary arrays stay in the cache, and take no new memory.
_AT_ONCE = 4096
# Makes one number of a kind and a sum of random numbers: odd, of 64 random bits.
_MIXING = np.uint64(0x9E3779B97F4A7C15)


def prove_rows_of_nodes(body: FEModel, nodes: Nodes, tolerance: float = 0.0) -> HiddenRows:
    """Look for rows of one node among those of another, in a stiffness that costs no rigid motion a force.

    Parameters
    ----------
    body : FEModel
        n dofs.
    nodes : Nodes
        Its geometry.
    tolerance : float
        Relative force that round-off may leave under rigid motion.

    Raises
    ------
    DofMapError
        If an exchange of rows explains couplings that other rows of their nodes do not have; the message names them.
    """
    at = np.unique(body.dofs.node, return_inverse=True)[1]
    unsettled = _of_several_surroundings(body, at)
    if not unsettled.any():
        return NONE_HIDDEN
    kind, several = _kinds(body, nodes, min(max(_ROUND_OFF * tolerance, _NEAREST), _FARTHEST))
    rows, chains = np.flatnonzero(unsettled & several), prove_chains(body, nodes, kind)
    if not rows.size:
        return chains
    coupled, moving = _coupled(body), body.dofs.component <= 3
    places = nodes.xyz[nodes.index(body.dofs.node)]
    alike, first, second = _exchanges(coupled, at, moving, places, kind, rows)
    true = _put_back(coupled, at, moving, rows[first], rows[second])
    moved, hidden = np.flatnonzero(true != np.arange(body.n)), rows[alike]
    if not moved.size and not hidden.size:
        return chains
    labels = body.dofs.labels
    if moved.size:
        named = "; ".join(f"the row labelled {labels[k]} is that of {labels[true[k]]}" for k in moved[:_NAMED])
        raise DofMapError(
            f"body '{body.name}': the row order of the stiffness matrix is not proven: {moved.size} rows couple other "
            f"nodes than the other rows of their node. Likely cause: {named}"
            f"{f', and {moved.size - _NAMED} more' if moved.size > _NAMED else ''}; put back, the couplings agree, and "
            "rigid motion costs no force in both orders. Give the order of the rows as a list of node.component under "
            "`rows:`. Scalar springs or ties between these nodes may look the same"
        )
    why = (
        "move under rigid motion as rows of other nodes do, and what they couple does not tell their nodes apart: an "
        "exchange of such rows would not show"
    )
    return hidden_rows(body, hidden, why, turning=not moving[hidden].all()).joined(chains)


def _of_several_surroundings(body: FEModel, at: Indices) -> Flags:
    """Rows (n,) of nodes whose rows couple different nodes, or those of another node's rows, or one component alone.

    Elements couple all rows of a node with the same nodes, in whatever order the rows are labelled. Rows of a node that
    are not side by side count several times, which leaves more to be looked at.
    """
    weight = np.random.default_rng(1).integers(0, 2**63, int(at.max()) + 1, dtype=np.uint64)
    component, short, K = (1 << body.dofs.component).astype(np.int8), at.astype(np.int32), body.K
    around, coupled, filled = np.zeros(body.n, np.uint64), np.zeros(body.n, np.int8), np.zeros(body.n, dtype=bool)

    def look(_: int, rows: slice) -> None:
        starts = K.indptr[rows.start : rows.stop + 1]
        entries = slice(starts[0], starts[-1])
        kept = np.flatnonzero(K.data[entries])
        column, starts = K.indices[entries][kept], np.searchsorted(kept, starts - starts[0])
        some = starts[:-1] < starts[1:]
        if not some.any():
            return
        each, near = starts[:-1][some], short[column]
        first = np.diff(near, prepend=-1) != 0
        first[each] = True
        nodes = np.flatnonzero(first)
        filled[rows] = some
        around[rows][some] = np.add.reduceat(weight[near[nodes]], np.searchsorted(nodes, each))
        coupled[rows][some] = np.bitwise_or.reduceat(component[column], each)

    share_rows(body.n, _AT_ONCE, look)
    mixed = coupled == component
    for key, other in ((around, at), (at, around), (around - weight[at], at)):
        order = np.lexsort((other, key))
        differ = (np.diff(key[order]) == 0) & (np.diff(other[order]) != 0)
        mixed[order[1:][differ]] = mixed[order[:-1][differ]] = True
    some = np.zeros(weight.size, dtype=bool)
    some[at[mixed & filled]] = True
    return np.asarray(some[at] & (body.dofs.component > 0) & filled)


def _kinds(body: FEModel, nodes: Nodes, same: float) -> tuple[Indices, Flags]:
    """Number (n,) that rows share which every rigid motion moves the same, and True for those that share it."""
    rows = np.flatnonzero(body.dofs.component > 0)
    R = rigid_body_shapes(body.dofs[rows], nodes, nodes.xyz.mean(axis=0))
    R[:, 3:] /= np.where(body.dofs.component[rows] > 3, 1.0, float(np.ptp(nodes.xyz, axis=0).max()) or 1.0)[:, None]
    place = np.empty(R.shape, dtype=np.int64)
    for column in range(R.shape[1]):
        order = np.argsort(R[:, column], kind="stable")
        steps = np.diff(R[order, column], prepend=R[order[:1], column]) > same
        place[order, column] = np.cumsum(steps)
    order = np.lexsort(place.T)
    kind = np.full(body.n, -1)
    kind[rows[order]] = np.cumsum(np.diff(place[order], axis=0, prepend=place[order[:1]]).any(axis=1))
    several = np.zeros(body.n, dtype=bool)
    several[rows] = np.bincount(kind[rows])[kind[rows]] > 1
    return kind, several


def _coupled(body: FEModel) -> sp.csr_array:
    """Sizes (n, n) of the entries between different dofs that are more than rounding, relative to both diagonals.

    Labels of rotations are in doubt where those of translations may be right: only rows without translations have
    entries with rotations.
    """
    K, own, component = body.K, np.sqrt(abs(body.K.diagonal())), body.dofs.component
    counts, values = np.diff(K.indptr), abs(K.data)
    size = own[K.indices]
    size *= np.repeat(own, counts)
    kept = values > max(COUPLED, DIGITS * body.rounding) * size
    kept &= K.indices != np.repeat(np.arange(body.n, dtype=K.indices.dtype), counts)
    if (component == 0).any():
        kept &= (component > 0)[K.indices] & np.repeat(component > 0, counts)
    if (component > 3).any():
        translation = (component <= 3)[K.indices]
        kept &= translation | np.repeat(_sums(kept & translation, K.indptr) == 0, counts)
    starts = np.concatenate([[0], np.cumsum(_sums(kept, K.indptr))])
    return sp.csr_array((values[kept] / size[kept], K.indices[kept], starts), shape=K.shape)


def _sums(flags: Flags, starts: NDArray[np.integer]) -> Indices:
    """Number of flags that are set in each part of an array."""
    filled = np.diff(starts) > 0
    found = np.zeros(filled.size, dtype=np.int64)
    found[filled] = np.add.reduceat(flags, starts[:-1][filled], dtype=np.int64)
    return found


def _surroundings(coupled: sp.csr_array, at: Indices, moving: Flags) -> tuple[sp.csr_array, sp.csr_array]:
    """Nodes that each row couples (n, N), and the number of translations of each node that couple each other (N, N).

    The node itself counts as coupled by all of its rows.
    """
    of_node = _of_nodes(at)
    own = _ones(sp.csr_array(coupled @ of_node))
    count = sp.csr_array(of_node[moving].T @ own[moving])
    return own, sp.csr_array(count + _ALL * sp.eye_array(count.shape[0], dtype=np.int32, format="csr"))


def _foreign(own: sp.csr_array, count: sp.csr_array, at: Indices, moving: Flags) -> Indices:
    """Number of nodes that each row couples and no other translation of its node does."""
    known = sp.csr_array(count[at].multiply(own))
    row = np.repeat(np.arange(at.size), np.diff(known.indptr))
    return np.diff(own.indptr) - np.bincount(row[known.data > moving[row]], minlength=at.size)


def _exchanges(
    coupled: sp.csr_array, at: Indices, moving: Flags, places: NDArray[np.float64], kind: Indices, rows: Indices
) -> tuple[Flags, Indices, Indices]:
    """Rows (k,) that an exchange with another row of their kind leaves with as few foreign nodes, and as near ones.

    The pairs (p,), (p,), by their positions among these rows, have fewer if they are exchanged.
    """
    own, count = _surroundings(coupled, at, moving)
    own, node, moving, of = own[rows], at[rows], moving[rows], kind[rows]
    around, size, nodes = _ones(count), np.diff(own.indptr), count.shape[0]
    weight = np.random.default_rng(1).integers(0, 2**62, nodes)
    here, there = own @ weight, (around @ weight)[node]
    foreign = _foreign(own, count, node, moving)
    # Rows among those of others: more of their kind may be, as in a part of a chain from end to end.
    hidden = np.isin(of, of[foreign > 0])
    # A row without its own node, where entries cancel, couples all the others.
    full = (foreign == 0) & ((here == there) | (here == there - weight[node]))
    # An exchange of rows that couple all the same nodes changes nothing, whether their own are among these or not.
    for nodes_of in (there, here):
        key = (of.astype(np.uint64) * _MIXING + nodes_of.astype(np.uint64))[full]
        same, many = np.unique(key, return_inverse=True, return_counts=True)[1:]
        hidden[full] |= many[same] > 1
    some = np.flatnonzero(~full)
    if (own[some] @ np.diff(around.indptr).astype(np.int64)).sum() > _PAIRS * coupled.nnz + _FEWEST_PAIRS:
        hidden[some] = True
        return hidden, some[:0], some[:0]
    common = sp.coo_array(own[some] @ around)
    # The row of the same kind at each node.
    order = np.argsort(of * nodes + node, kind="stable")
    keys, wanted = (of * nodes + node)[order], of[some[common.row]] * nodes + common.col
    found = np.minimum(np.searchsorted(keys, wanted), rows.size - 1)
    kept = (keys[found] == wanted) & (node[some[common.row]] != common.col)
    first, second = some[common.row[kept]], order[found[kept]]
    left, now = size[first] - common.data[kept], foreign[first] + foreign[second]
    kept = left <= now
    first, second, now = first[kept], second[kept], now[kept]

    def beyond(row: Indices, other: Indices) -> Indices:
        """Nodes that a row would couple alone in the place of another one."""
        by_others = count[node[other]] - own[other].multiply(moving[other][:, None])
        return np.asarray(size[row] - np.asarray((own[row].multiply(by_others) > 0).sum(axis=1)).ravel())

    left = beyond(first, second) + beyond(second, first)
    better = left < now
    pairs = np.stack([first, second])[:, left == now]
    near = _stay_near(coupled, places, kind, rows[pairs])
    hidden[pairs[:, near]] = True
    hidden[first[better]] = hidden[second[better]] = True
    return hidden, first[better], second[better]


def _stay_near(coupled: sp.csr_array, places: NDArray[np.float64], kind: Indices, pairs: Indices) -> Flags:
    """True for pairs of rows (2, p) whose exchange takes them no farther from the rows of their kind that they couple.

    Bars along a line make a chain of such rows. In another order than that of their places, but the reverse, the chain
    goes to and fro.
    """

    def reach(row: Indices, other: Indices, place: Indices) -> NDArray[np.float64]:
        """Sum of distances from a row's place; those from the other row of its pair stay."""
        part = coupled[row]
        of = np.repeat(np.arange(row.size), np.diff(part.indptr))
        counts = (kind[part.indices] == kind[row][of]) & (part.indices != other[of])
        away = np.linalg.norm(places[part.indices] - places[place][of], axis=1)
        return np.asarray(np.bincount(of, counts * away, row.size))

    first, second = pairs
    before = reach(first, second, first) + reach(second, first, second)
    return np.asarray(reach(first, second, second) + reach(second, first, first) <= (1 + _FARTHER) * before)


def _ones(A: sp.csr_array) -> sp.csr_array:
    """Entries as ones."""
    return sp.csr_array((np.ones(A.nnz, np.int32), A.indices, A.indptr), shape=A.shape)


def _of_nodes(at: Indices) -> sp.csr_array:
    """Node of each row (n, N)."""
    return sp.csr_array((np.ones(at.size, np.int32), at, np.arange(at.size + 1)), shape=(at.size, int(at.max()) + 1))


def _put_back(coupled: sp.csr_array, at: Indices, moving: Flags, first: Indices, second: Indices) -> Indices:
    """Labels of rows after the best exchanges, if they leave no couplings to explain; else as they are."""
    same = np.arange(at.size)
    moved, of = np.unique(np.concatenate([first, second]), return_inverse=True)
    if not 0 < moved.size <= _MOST:
        return same
    # Imported here: it loads libraries that only refusals need.
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    own, count = _surroundings(coupled, at, moving)
    near = _ones(count)
    pairs = np.concatenate([np.stack([of[: first.size], of[first.size :]]), np.tile(np.arange(moved.size), (2, 1))], 1)
    row, to = moved[pairs]
    shared = np.asarray(own[row].multiply(near[at[to]]).sum(axis=1)).ravel()
    both = np.diff(own.indptr)[row] + np.diff(near.indptr)[at[to]] - shared
    cost = sp.csr_array((2 - shared / both, (pairs[0], pairs[1])), shape=(moved.size, moved.size))
    true = same.copy()
    true[moved] = moved[min_weight_full_bipartite_matching(cost)[1]]
    # Columns are named anew, and so are rows.
    back = np.argsort(true)
    before = _foreign(own, count, at, moving)
    after = _foreign(*_surroundings(coupled[back][:, back], at, moving), at, moving)
    # A spring between two nodes of a sound body: one row of an exchange gains nothing, or couples other nodes still.
    out = true != same
    unexplained = (before[out] == 0) | (after[out] > 0)
    return true if unexplained.sum() <= _LEFT * out.sum() else same
