"""Masses of the nodes of a body: evidence for the order of its mass matrix that no sum over the body has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import SCALAR, FEModel, cross_matrix, entry_errors

__all__ = [
    "MomentsToward",
    "exchanges_hidden",
    "generalised_coordinates",
    "inner_masses",
    "lumps",
    "momentum_of_nodes",
    "moments_toward_neighbours",
]

Array = NDArray[np.float64]

# All pairs of nodes are tried: 600 nodes are 180 000 pairs.
_MOST_NODES = 600
# An exchange shows if it changes the symmetric part of the first moments by more than ten times the limit of that
# check (1e-6 of mass times size), and a hundred roundings of the file.
_SHOWS, _ROUNDINGS = 1e-5, 1e3

# An entry between two dofs relative to the diagonal entries of both: less is round-off.
_COUPLED = 1e-9
# First moments of mass below this share of mass times length are rounding.
_MOMENT = 1e-6
# Agreement of the first moments of mass with the neighbours: 1 in beams, less where elements are bent or plates.
_TOWARD = 0.5
# Axes in another order must agree better by this much to be a doubt.
_BETTER = 0.1
# Agreement of first moments with the neighbours of which no exchange of axes is in doubt.
_AGREES = 0.9


def lumps(body: FEModel) -> Array | None:
    """Least eigenvalue of each node's block of a lumped mass, scaled to a unit diagonal; None if nodes are coupled.

    Each diagonal entry is raised by the rounding of its row, as rods turn about one axis alone.
    """
    M, (_, rows) = body.M, np.unique(body.dofs.node, return_counts=True)
    if np.diff(M.indptr).max(initial=0) > rows.max(initial=0):
        # The block of a node has no more entries in a column.
        return None
    column = np.repeat(np.arange(body.n), np.diff(M.indptr))
    if (body.dofs.node[M.indices] != body.dofs.node[column]).any():
        return None
    _, node = np.unique(body.dofs.node, return_inverse=True)
    order = np.argsort(node, kind="stable")
    place = np.empty(body.n, dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(np.bincount(node))])
    place[order] = np.arange(body.n) - first[node[order]]
    width = int(place.max(initial=0)) + 1
    blocks = np.zeros((first.size - 1, width, width))
    own = abs(M.diagonal())
    scale = 1 / np.sqrt(np.where(own > 0, own, max(float(own.max(initial=0.0)), np.finfo(float).tiny)))
    blocks[node[column], place[M.indices], place[column]] = M.data * scale[M.indices] * scale[column]
    errors = entry_errors(M.data, body.rounding) * scale[M.indices] * scale[column]
    blocks[node, place, place] += np.bincount(M.indices, errors, body.n)
    return np.asarray(np.linalg.eigvalsh(blocks)[:, 0])


def momentum_of_nodes(body: FEModel) -> tuple[NDArray[np.int64], Array]:
    """Nodes, and the momentum (N, 3, 3) of the translations of each node under unit translations of the body."""
    assert body.nodes is not None
    R = body.rigid_shapes[:, :3]
    rows = np.flatnonzero((body.dofs.component > 0) & (body.dofs.component <= 3))
    ids, of = np.unique(body.dofs.node[rows], return_inverse=True)
    of_node = sp.csr_array((np.ones(rows.size), (of, np.arange(rows.size))))
    P = of_node @ (R[rows, :, None] * body.rigid_momentum[rows, None, :3]).reshape(-1, 9)
    return ids, np.asarray(P).reshape(-1, 3, 3)


def generalised_coordinates(body: FEModel) -> int:
    """Scalar dofs without stiffness in common with others, as fixed-interface modes, if their masses are not alike.

    An exchange of two of them in the mass alone leaves mass, centre and inertia of the body, and the pairs of nodes.
    Where none shares mass with a node and all have one mass, it leaves the matrix, too. Dofs inside elements share
    stiffness with their nodes.
    """
    scalar = body.dofs.component == SCALAR
    if not scalar.any():
        return 0

    def shared(A: sp.csc_array) -> NDArray[np.bool_]:
        entries, own = sp.coo_array(A), np.sqrt(abs(A.diagonal()))
        least = max(_COUPLED, _ROUNDINGS * body.stiffness_rounding) * own[entries.row] * own[entries.col]
        found = np.zeros(body.n, dtype=bool)
        found[entries.row[(entries.row != entries.col) & (abs(entries.data) > least)]] = True
        return found

    alone = scalar & (body.K.diagonal() > 0) & ~shared(body.K)
    count, mass = int(alone.sum()), body.M.diagonal()[alone]
    if count < 2:
        return 0
    alike = np.ptp(mass) <= max(_COUPLED, _ROUNDINGS * body.rounding) * mass.max()
    return 0 if alike and not shared(body.M)[alone].any() else count


def inner_masses(body: FEModel) -> int:
    """Scalar dofs with different masses, as those inside elements; 0 if they are alike and share mass with no others.

    An exchange of two of them in the mass alone leaves the masses of all nodes.
    """
    inner = np.flatnonzero((body.dofs.component == SCALAR) & (body.M.diagonal() > 0))
    if inner.size < 2:
        return 0
    own = body.M.diagonal()[inner]
    alike = np.ptp(own) <= _COUPLED * own.max() and body.M[:, inner].nnz == inner.size
    return 0 if alike else int(inner.size)


def exchanges_hidden(body: FEModel) -> int | None:
    """Pairs of nodes whose exchange in the mass would leave one centre of mass; None if there are too many nodes.

    The masses that a condensed body has at a node differ by direction. An exchange of two nodes then gives a coupling
    of translations with rotations that is not skew, as no centre of mass gives.
    """
    assert body.nodes is not None
    ids, P = momentum_of_nodes(body)
    if not 1 < ids.size <= _MOST_NODES:
        return None
    at = body.nodes.index(ids)
    kind = np.array([np.sum(1 << body.dofs.component[body.dofs.node == node].astype(np.int64)) for node in ids])
    first, second = np.triu_indices(ids.size, 1)
    same = kind[first] == kind[second]
    first, second = first[same], second[same]
    if not first.size:
        return 0
    size = float(np.ptp(body.nodes.xyz, axis=0).max()) or 1.0
    mass = float(np.trace(P.sum(axis=0)) / 3)
    arm = cross_matrix(body.nodes.xyz[at[first]] - body.nodes.xyz[at[second]])
    change = arm @ (P[second] - P[first])
    shown = abs(change + change.transpose(0, 2, 1)).max(axis=(1, 2))
    return int((shown <= max(_SHOWS, _ROUNDINGS * body.rounding) * mass * size).sum())


@dataclass(frozen=True)
class MomentsToward:
    """Agreement, from -1 to 1, of the first moments of mass at the nodes with the directions of their neighbours.

    Parameters
    ----------
    as_given : float
        Of the mass as it is.
    best : float
        The largest of `as_given` and of those with axes exchanged at every node.
    order : str
        Axes that make it, such as ``y, x, z`` in place of x, y and z.
    """

    as_given: float
    best: float
    order: str

    @property
    def doubtful(self) -> bool:
        """True if the mass is not in the order of the stiffness, or axes in another order agree better."""
        return self.as_given < max(_TOWARD, self.best - _BETTER)

    @property
    def in_words(self) -> str:
        """Reason to doubt the order."""
        other = "rows in reverse, of another sign or in another frame"
        if self.best - _BETTER > self.as_given:
            other = f"another order of axes ({self.best:.2f} with {self.order} in place of x, y, z)"
        return (
            f"its first moments point to the neighbours of their nodes by {self.as_given:.2f} of 1, as those of "
            f"{other}; masses beside their grids do so, too"
        )


def moments_toward_neighbours(body: FEModel, mass: sp.csc_array) -> MomentsToward | None:
    """Direction of the first moment of the mass at each node, beside that of its neighbours.

    ``mass`` is the mass matrix of the body, without masses that are known to lie beside their nodes.

    A node of a consistent mass with rotations carries a part of each element; its first moment points along the
    element. In reversed rows of a symmetric chain, or rows of another sign or frame, it does not, although every node
    has its mass. With two axes exchanged in the mass alone some of a bent chain still do: then the exchange that puts
    them back agrees better.

    Returns
    -------
    MomentsToward or None
        None if the mass couples no rotations with translations, or no nodes.
    """
    assert body.nodes is not None
    component = body.dofs.component
    moving, turning = ((component > k) & (component <= k + 3) for k in (0, 3))
    if not turning.any():
        return None
    R = body.rigid_shapes
    ids, node = np.unique(body.dofs.node, return_inverse=True)
    M = sp.coo_array(mass)
    both = moving[M.row] & moving[M.col] & (node[M.row] != node[M.col])
    row, column = M.row[both], M.col[both]
    shared = M.data[both] * np.einsum("ij,ij->i", R[row, :3], R[column, :3])
    xyz = body.nodes.xyz[body.nodes.index(ids)]
    around = np.zeros((ids.size, 3))
    np.add.at(around, node[row], shared[:, None] * (xyz[node[column]] - xyz[node[row]]))
    reach = np.linalg.norm(around)

    def agreement(rows: NDArray[np.int64]) -> float | None:
        """Of the mass with its rows and columns in another order."""
        moved = np.empty_like(R[:, :3])
        moved[rows] = R[:, :3]
        H = np.zeros((ids.size, 3, 3))
        np.add.at(H, node[turning], R[turning, 3:, None] * np.asarray(mass @ moved)[rows][turning, None, :])
        # The moment of momentum under the velocity v is s x v.
        s = np.stack([H[:, 2, 1] - H[:, 1, 2], H[:, 0, 2] - H[:, 2, 0], H[:, 1, 0] - H[:, 0, 1]], axis=1) / 2
        if reach == 0 or np.linalg.norm(H) <= _MOMENT * reach:
            return None
        return float(np.sum(s * around) / (max(np.linalg.norm(s), _MOMENT * np.linalg.norm(H)) * reach))

    as_given = agreement(np.arange(body.n))
    if as_given is None:
        return None
    found = {"x, y, z": as_given}
    if as_given < _AGREES:
        for order in list(permutations(range(3)))[1:]:
            found[", ".join("xyz"[k] for k in order)] = max(
                agreement(rows) or 0.0 for rows in _exchanged(body, order, (moving, moving | turning))
            )
    best = max(found, key=lambda each: found[each])
    return MomentsToward(as_given, found[best], best)


def _exchanged(
    body: FEModel, order: tuple[int, ...], kinds: Iterable[NDArray[np.bool_]]
) -> Iterator[NDArray[np.int64]]:
    """Order of the rows with the axes of every node exchanged, for dofs of each kind; nodes that lack an axis stay."""
    node, component = body.dofs.node, body.dofs.component
    first = (component - 1) // 3 * 3
    other = first + 1 + np.array(order)[(component - 1) % 3]
    to = body.dofs.rows(node, other)
    _, of = np.unique(node * 2 + first // 3, return_inverse=True)
    whole = np.bincount(of, weights=to >= 0)[of] == 3
    for kind in kinds:
        yield np.where(kind & whole, to, np.arange(body.n))
