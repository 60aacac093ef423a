"""Proof that the rows of a mass matrix are those of the stiffness: a consistent mass couples the same pairs of nodes.

An exchange of whole nodes leaves pairs that the mass couples and the stiffness does not, and as many the other way
round. Masses spread over nodes, and scalar masses, add pairs to the mass; springs and lumped elements add pairs to the
stiffness; neither is an exchange.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import SCALAR, FEModel
from cmsreduce.read.row_order.mass_rows import refuse_rows, rows_among_others

__all__ = ["COUPLED", "DIGITS", "MassOrder", "Pairs", "coupled", "prove_mass_order", "refuse_exchange"]

Graph = sp.csr_array

# An entry of the mass couples two dofs if it exceeds this share of the masses of both, and the digits of its file.
COUPLED, DIGITS = 1e-9, 100.0
# Exchanges that are named; a mass with more is in another order altogether.
_NAMED, _MOST = 5, 24
# Nodes that are exchanged back keep at most this share of their pairs unexplained.
_LEFT = 0.1
# Rounds of colouring: each node knows the couplings of nodes so far away.
_ROUNDS = 3
# Odd factors that spread a colour over 64 bits: those of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014).
_GOLDEN, _MIXING = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBF58476D1CE4E5B9)
# Colours that no other labels explain, relative to the nodes whose colours differ.
_OTHER_GRAPH = 0.25


@dataclass(frozen=True)
class MassOrder:
    """Result of the proof of the order of the mass matrix.

    Parameters
    ----------
    status : str
        ``proven``: no two nodes can be exchanged without notice. ``lumped``: the mass couples no nodes. ``alike``:
        some nodes couple with the same other nodes. ``mixed``: the mass couples pairs that the stiffness does not,
        and the other way round, but no exchange explains it. ``scalar``: no dof belongs to a node. ``modal``: the rows
        are those of the stiffness by one change of coordinates.
    pairs : int
        Pairs of nodes that the mass couples.
    nodes : int
        Nodes with rows.
    alike : int
        Nodes that can be exchanged with another node without a change of the pairs.
    remark : str
        Evidence, or the reason why there is no proof.
    """

    status: Literal["proven", "lumped", "alike", "mixed", "scalar", "modal"]
    pairs: int = 0
    nodes: int = 0
    alike: int = 0
    remark: str = ""


def prove_mass_order(body: FEModel) -> MassOrder:
    """Compare the pairs of nodes that the mass couples with those that the stiffness couples.

    Parameters
    ----------
    body : FEModel
        Body as read.

    Returns
    -------
    MassOrder

    Raises
    ------
    DofMapError
        If the mass couples other pairs than the stiffness, and the same pairs with other node numbers, or with rows of
        one component in another order; the message names the nodes or rows.
    """
    if (body.dofs.component == SCALAR).all():
        return MassOrder("scalar", remark="all dofs are scalar, so that nothing shows the order of the mass")
    ids, node = np.unique(body.dofs.node, return_inverse=True)
    share = max(COUPLED, DIGITS * body.rounding)
    mass, any_mass = coupled(body.M, node, ids.size, share)
    if not mass.nnz:
        return MassOrder("lumped", 0, ids.size, ids.size, "the mass is lumped: no pair of nodes shows its order")
    case, same = Pairs(body, ids, node, share, mass, any_mass), np.arange(ids.size)
    beyond = sp.csr_array(mass.shape, dtype=mass.dtype) if _within(body.M, body.K) else case.beyond(same)
    pairs, alike = mass.nnz // 2, _alike(mass)
    if beyond.nnz and (lacking := case.lacking(same)).nnz:
        refuse_exchange(case, beyond, lacking)
        both = np.flatnonzero((np.diff(beyond.indptr) > 0) & (np.diff(lacking.indptr) > 0))
        if both.size:
            return MassOrder(
                "mixed",
                pairs,
                ids.size,
                alike,
                f"at {both.size} of {ids.size} nodes the mass couples other nodes than the stiffness (node "
                f"{ids[both[0]]} and others), as masses spread over nodes do, so that pairs do not show its order",
            )
    if beyond.nnz:
        moved, apart = rows_among_others(body.M, body.dofs.component, node, case.any_stiff, share)
        if moved.size:
            refuse_rows(body, moved)
        if apart.size:
            return MassOrder(
                "mixed",
                pairs,
                ids.size,
                alike,
                f"{apart.size} rows of the mass ({body.dofs.labels[apart[0]]} and others) couple other nodes than the "
                "other rows of their node, as rows of one component in another order do, so that pairs do not show it",
            )
    extra = f"; {beyond.nnz // 2} pairs are coupled by mass alone" if beyond.nnz else ""
    found = f"the mass couples the {pairs} pairs of nodes that the stiffness couples{extra}"
    if alike:
        return MassOrder(
            "alike",
            pairs,
            ids.size,
            alike,
            f"{found}; {alike} of {ids.size} nodes couple with the same nodes as another",
        )
    return MassOrder("proven", pairs, ids.size, 0, found)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of nodes coupled by mass and by stiffness: by more than rounding, and by any entry.

    ``kind`` names another matrix in place of the mass. Those of the stiffness are found when they are asked for: most
    masses couple no dofs that it does not.
    """

    body: FEModel
    ids: NDArray[np.int64]
    node: NDArray[np.int64]
    share: float
    mass: Graph
    any_mass: Graph
    kind: str = "mass"

    @cached_property
    def _stiffness(self) -> tuple[Graph, Graph]:
        return coupled(self.body.K, self.node, self.ids.size, self.share)

    @property
    def stiff(self) -> Graph:
        """Pairs coupled by the stiffness, by more than rounding."""
        return self._stiffness[0]

    @property
    def any_stiff(self) -> Graph:
        """Pairs coupled by any entry of the stiffness."""
        return self._stiffness[1]

    def beyond(self, label: NDArray[np.int64]) -> Graph:
        """Pairs coupled by mass alone, if the mass had the rows of other nodes."""
        return _without(_relabelled(self.mass, label), self.any_stiff)

    def lacking(self, label: NDArray[np.int64]) -> Graph:
        """Pairs coupled by stiffness alone."""
        return _without(self.stiff, _relabelled(self.any_mass, label))


def _within(M: sp.csc_array, K: sp.csc_array) -> bool:
    """True if the stiffness couples every two dofs that the mass couples; a product that underflows says False."""
    return bool(np.count_nonzero(M.multiply(K).data) == np.count_nonzero(M.data))


def coupled(A: sp.csc_array, node: NDArray[np.int64], count: int, share: float) -> tuple[Graph, Graph]:
    """Pairs of different nodes that a matrix couples by more than rounding, and by any entry: symmetric, of ones."""
    counts, short, own = np.diff(A.indptr), node.astype(np.int32), np.sqrt(abs(A.diagonal()))
    first, second = short[A.indices], np.repeat(short, counts)
    apart = (first != second) & (A.data != 0)
    firm = apart & (abs(A.data) > share * own[A.indices] * np.repeat(own, counts))

    def graph(rows: NDArray[np.int32], columns: NDArray[np.int32]) -> Graph:
        ones = np.ones(rows.size, dtype=np.int32)
        found = sp.csr_array(sp.coo_array((ones, (rows, columns)), shape=(count, count)))
        found.data[:] = 1
        return found

    whole = graph(first[apart], second[apart])
    return (whole if (firm == apart).all() else graph(first[firm], second[firm])), whole


def _relabelled(graph: Graph, label: NDArray[np.int64]) -> Graph:
    """Graph whose node k gets the number ``label[k]``."""
    if np.array_equal(label, np.arange(label.size)):
        return graph
    back = np.argsort(label)
    return sp.csr_array(graph[back][:, back])


def _without(graph: Graph, other: Graph) -> Graph:
    """Pairs of one graph that another one lacks."""
    left = sp.csr_array(graph - graph.multiply(other))
    left.eliminate_zeros()
    return left


def _sums(graph: Graph, value: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Sum of the values of all neighbours of each node, modulo 2^64."""
    running = np.concatenate([np.zeros(1, np.uint64), np.cumsum(value[graph.indices], dtype=np.uint64)])
    return np.asarray(running[graph.indptr[1:]] - running[graph.indptr[:-1]])


def _random(count: int) -> NDArray[np.uint64]:
    return np.random.default_rng(1).integers(0, 2**63, count, dtype=np.uint64)


def _alike(graph: Graph) -> int:
    """Nodes that couple with the same other nodes as another node does."""
    weight = _random(graph.shape[0])
    around = _sums(graph, weight)
    twin = np.zeros(weight.size, dtype=bool)
    # Two nodes that are coupled with each other have the same neighbours if they count themselves, too.
    for key in (around, around + weight):
        _, of, count = np.unique(key, return_inverse=True, return_counts=True)
        twin |= count[of] > 1
    return int(twin.sum())


def _colours(graph: Graph) -> NDArray[np.uint64]:
    """Numbers that are the same for nodes whose surroundings are coupled in the same way (Weisfeiler and Leman)."""
    colour = np.diff(graph.indptr).astype(np.uint64)
    for _ in range(_ROUNDS):
        mixed = (colour + np.uint64(1)) * _GOLDEN
        mixed ^= mixed >> np.uint64(29)
        colour = mixed * np.uint64(3) + _sums(graph, mixed * _MIXING)
    return colour


def refuse_exchange(case: Pairs, beyond: Graph, lacking: Graph) -> None:
    """Refuse a mass that couples the pairs of the stiffness after its nodes are numbered anew."""
    label = _exchanged_back(case, beyond)
    where = ", ".join(dict.fromkeys(source.path for source in case.body.sources if case.kind in source.holds))
    kind, file = case.kind, f" ({where})" if where else ""
    head = (
        f"body '{case.body.name}': the rows of the {kind} matrix{file} are not in the order of the stiffness: "
        f"{beyond.nnz // 2} pairs of nodes have {kind} in common and no stiffness, and {lacking.nnz // 2} pairs have "
        f"stiffness in common and no {kind}"
    )
    remedy = "Write both matrices from one run with one dof set, or label the rows of both files"
    if label is not None:
        moved = np.flatnonzero(label != np.arange(label.size))
        named = "; ".join(
            f"the rows labelled node {case.ids[k]} are those of node {case.ids[label[k]]}" for k in moved[:_NAMED]
        )
        more = f", and {moved.size - _NAMED} more" if moved.size > _NAMED else ""
        raise DofMapError(f"{head}. Likely cause: {named}{more}; put back, the pairs agree. {remedy}")
    if (order := _by_appearance(case)) is not None:
        raise DofMapError(
            f"{head}. Likely cause: the {kind} has its rows in the {order}; in that order the pairs agree. {remedy}"
        )
    mass, stiff = _colours(case.mass), _colours(case.stiff)
    differ = int((mass != stiff).sum())
    _, of = np.unique(np.concatenate([mass, stiff]), return_inverse=True)
    count = np.bincount(of[: mass.size], minlength=of.max() + 1) - np.bincount(of[mass.size :], minlength=of.max() + 1)
    if differ and abs(count).sum() / 2 <= _OTHER_GRAPH * differ:
        raise DofMapError(
            f"{head}. Likely cause: rows are shuffled among nodes: the {kind} couples its nodes as the stiffness "
            f"does, but {differ} of {case.ids.size} nodes have other numbers. {remedy}"
        )


def _by_appearance(case: Pairs) -> str | None:
    """The mass follows the order of the nodes in the geometry file, the stiffness that of their ids; or vice versa."""
    if case.body.nodes is None:
        return None
    place = case.body.nodes.index(case.ids)
    order = np.argsort(np.where(place >= 0, place, place.size + np.arange(place.size)), kind="stable")
    back = np.argsort(order)
    for name, label in (("order of appearance of the nodes in the geometry file", order), ("order of node ids", back)):
        if np.array_equal(label, np.arange(label.size)):
            return None
        if case.beyond(label).nnz == 0:
            return name
    return None


def _exchanged_back(case: Pairs, beyond: Graph) -> NDArray[np.int64] | None:
    """True node of each node's rows in the mass, if a few exchanges explain all pairs coupled by mass alone.

    The node with the most such pairs gets the label of the node whose neighbours in the stiffness are most like its
    own, again and again.
    """
    label = np.arange(case.ids.size)
    degree = np.diff(case.any_stiff.indptr) + 1
    left, before = beyond, beyond.nnz
    for _ in range(_MOST):
        counts = np.diff(left.indptr)
        if not counts.any():
            break
        best, lacking = None, np.diff(case.lacking(label).indptr)
        for a in np.argsort(-counts, kind="stable")[:_NAMED]:
            b = _most_alike(case, label, int(a), degree, lacking)
            if b is None or b == a or counts[a] == 0:
                continue
            # The rows that bear the labels a and b now are exchanged.
            tried = label.copy()
            tried[label == a], tried[label == b] = b, a
            rest = case.beyond(tried)
            if rest.nnz < left.nnz and (best is None or rest.nnz < best[1].nnz):
                best = tried, rest
        if best is None:
            return None
        label, left = best
    moved = np.flatnonzero(label != np.arange(label.size))
    if not moved.size or left.nnz > _LEFT * before:
        return None
    # Lumped nodes of a spread mass could be exchanged, too, but would still lack the pairs of the stiffness.
    lacked = np.diff(case.lacking(label).indptr)[label[moved]]
    return label if (lacked <= _LEFT * np.diff(case.stiff.indptr)[label[moved]]).all() else None


def _most_alike(
    case: Pairs, label: NDArray[np.int64], a: int, degree: NDArray[np.int64], lacking: NDArray[np.int64]
) -> int | None:
    """Node whose neighbours in the stiffness are most like those of node ``a`` in the relabelled mass.

    Of nodes with the same neighbours, as in the middle of edges of one element, it is the one that lacks most pairs.
    """
    row = int(np.flatnonzero(label == a)[0])
    around = label[case.mass.indices[case.mass.indptr[row] : case.mass.indptr[row + 1]]]
    near = np.zeros(label.size)
    near[around] = 1
    common = case.any_stiff @ near + near
    if not common.any():
        return None
    share = common / (degree + around.size + 1 - common)
    same = np.flatnonzero(share == share.max())
    return int(same[lacking[same].argmax()])
