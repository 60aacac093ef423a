"""Row order of a body that the ground holds: the forces against rigid motion at each node alone.

A node away from the ground resists no rigid motion. A node on a spring to ground resists as the spring does. A node
next to dofs without rows resists translation and rotation. Rows of another node resist rotation alone, because an
exchange of whole nodes changes no sum over the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import DofTable, FEModel, Nodes, each_once
from cmsreduce.read.row_order.rigid_residual import RigidResidual, rigid_residual

__all__ = ["HeldRows", "beside_supports", "held_in_a_plane", "held_rows", "shown_rows", "supports_of"]

# Relative to the other forces at a node: a smaller one is round-off.
_NO_FORCE = 1e-6
# A body without supports has so many motions.
_ALL = 6
# Distance or motion relative to the size of the body: an exchange of closer nodes makes forces that may be round-off.
_ONE_PLACE = 1e-5
# Roundings of the file that add up over a row.
_ROUNDINGS = 1e3
# Largest condition of the block of a node from which the place that makes a force vanish is known.
_SURE = 1e6
# Nodes around one whose exchanges are tried: those of dense matrices are too many.
_MOST_AROUND = 500


@dataclass(frozen=True, eq=False)
class HeldRows:
    """Nodes by their forces against rigid motion.

    Parameters
    ----------
    found : RigidResidual
        Forces of all six motions.
    proven : (k,) int64
        Nodes without force, and nodes on a spring to ground of their own.
    held : (h,) int64
        Nodes next to the ground, whose rows nothing proves.
    wrong : (w,) int64
        Nodes that resist rotation of the body and no translation, far from dofs without rows.
    far : (p,) int64
        Held nodes that resist translation, if all of them are farther from the supports than from nodes that they
        couple.
    """

    found: RigidResidual
    proven: NDArray[np.int64]
    held: NDArray[np.int64]
    wrong: NDArray[np.int64]
    far: NDArray[np.int64]


def held_rows(body: FEModel, nodes: Nodes, condensed: bool, matrix: sp.csc_array | None = None) -> HeldRows:
    """Sort the nodes of a body that the ground holds.

    Parameters
    ----------
    body : FEModel
        Body as read.
    nodes : Nodes
        Its geometry.
    condensed : bool
        True if K comes from condensation.
    matrix : (n, n) sparse array, optional
        Damping in place of the stiffness.
    """
    A = body.K if matrix is None else matrix
    return _sorted(body, nodes, A, rigid_residual(A, body.dofs, nodes, None, body.rounding, condensed, body.noise))


def held_in_a_plane(body: FEModel, nodes: Nodes, condensed: bool) -> HeldRows | None:
    """Sort the nodes by the motions in a plane alone, as of a structure that supports hold in it.

    None if some nodes have a row across each plane.
    """
    if (rest := _without_rows(body.dofs)) is None:
        return None
    found = _in_plane(rigid_residual(body.K, body.dofs, nodes, rest, body.rounding, condensed, body.noise))
    if found is None:
        return None
    return _sorted(body, nodes, body.K, found)


def shown_rows(body: FEModel, nodes: Nodes, found: RigidResidual) -> NDArray[np.bool_]:
    """Rows (n,) whose order the motions that were tried show.

    A row that none of them moves has no force in any order, unless it is the last of the three along the axes of its
    node; nor have rows of nodes that move alike, apart from nodes at one place, which no rigid motion tells apart.
    """
    if found.motions.shape[1] == _ALL and np.linalg.matrix_rank(found.motions) == _ALL:
        return np.ones(len(body.dofs), dtype=np.bool_)
    # Imported here: it loads libraries that a body with all motions does not need.
    from scipy.spatial import cKDTree

    component = body.dofs.component
    turning = component > 3
    # Shapes of rotations are per length.
    moved = abs(found.shapes).max(axis=1, initial=0.0) * np.where(turning, found.length, 1.0) > _ONE_PLACE
    kind = 2 * body.dofs.node + turning
    _, of, count = np.unique(kind, return_inverse=True, return_counts=True)
    last = (count == 3) & (np.bincount(of[moved], minlength=count.size) == 2)
    shown = moved | last[of] | (component == 0)
    ids = each_once(body.dofs.node[component > 0])
    at = (nodes.xyz[nodes.index(ids)] - found.centre) / found.length
    one = np.unique(at, axis=0, return_index=True)[1]
    one = np.delete(one, np.unique(cKDTree(at[one]).query_pairs(_ONE_PLACE, output_type="ndarray")[:, 1]))
    # Displacement at each place under each motion.
    move = (found.motions[:3].T + np.cross(found.motions[3:].T, at[one, None, :])).reshape(one.size, -1)
    alike = np.asarray(cKDTree(move).query(move, k=[2])[0])[:, 0] <= _ONE_PLACE
    return np.asarray(shown & ~np.isin(body.dofs.node, ids[one[alike]]))


def _sorted(body: FEModel, nodes: Nodes, A: sp.csc_array, found: RigidResidual) -> HeldRows:
    """Nodes by their forces under the motions that were tried."""
    moving = body.dofs.component > 0
    ids, of = np.unique(body.dofs.node[moving], return_inverse=True)
    rows, turning = np.flatnonzero(moving), body.dofs.component[moving] > 3
    force, excess = abs(found.force[rows]), found.excess[rows]
    # The worst force of a row over its excess is the force that round-off may leave there.
    limit = np.divide(force.max(axis=1), excess, out=np.full(excess.size, np.inf), where=excess > 0)
    limit = np.maximum(limit, _NO_FORCE * _largest(force.max(axis=1), of, ids.size)[of])
    resists = _any(excess > 1, of, ids.size)
    pushed = _any((excess > 1) & (force[:, :3].max(axis=1) > limit), of, ids.size)
    across = _any((excess > 1) & ~turning, of, ids.size)
    # Forces under rotations about the node's own place: its own spring to ground has none.
    at = nodes.index(ids)
    arm = (nodes.xyz[at] - found.centre) / found.length
    by_arm = np.cross(np.eye(3), arm[:, None, :])
    own = found.force[rows, 3:] - np.einsum("rt,rjt->rj", found.force[rows, :3], by_arm[of])
    # A motion that is not tried has no force about any place.
    own *= abs(found.motions[3:]).max(axis=1) > _NO_FORCE
    sprung = ~_any(~turning & (abs(own).max(axis=1) > limit), of, ids.size) & _as_spring(body, found, rows, of, limit)
    whole = _whole(body, ids, A)
    wrong = resists & ~pushed & across & whole
    if wrong.any():
        beside = beside_supports(body, nodes, ids[wrong], A, supports_of(body, nodes))
        beside[beside] = ~_exchanged_around(body, ids[wrong][beside], A, found)
        wrong[wrong] = ~beside
    proven = ~resists | (pushed & sprung) | (~pushed & ~across)
    far = ids[pushed & ~proven & ~wrong]
    supports = np.union1d(supports_of(body, nodes), np.flatnonzero(~np.isin(nodes.id, ids)))
    if not supports.size or beside_supports(body, nodes, far, A, supports).any():
        far = far[:0]
    return HeldRows(found, ids[proven & ~wrong], ids[~proven & ~wrong], ids[wrong], far)


def supports_of(body: FEModel, nodes: Nodes, components: ArrayLike = (1, 2, 3)) -> NDArray[np.int64]:
    """Positions of nodes at rest in one of some components, the translations by default."""
    if body.constrained is None:
        return np.zeros(0, dtype=np.int64)
    held = nodes.index(body.constrained.node[np.isin(body.constrained.component, components)])
    return np.asarray(held[held >= 0])


def beside_supports(
    body: FEModel, nodes: Nodes, ids: NDArray[np.int64], A: sp.csc_array, supports: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """True for nodes (k,) that are as near to a support as to the farthest node that a matrix couples them with.

    Solids of second order may share an element with a support whose forces under translation cancel, as in a regular
    mesh of wedges. Supports are positions of nodes.
    """
    if not supports.size or not ids.size:
        return np.zeros(ids.size, dtype=np.bool_)
    # Imported here: it loads libraries that a body without such nodes does not need.
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(np.isin(body.dofs.node, ids) & (body.dofs.component > 0))
    part = A[:, rows]
    column = np.repeat(rows, np.diff(part.indptr))
    coupled = (part.data != 0) & (body.dofs.component[part.indices] > 0)
    node, other = body.dofs.node[column[coupled]], body.dofs.node[part.indices[coupled]]
    place = nodes.xyz[nodes.index(ids)]
    away = np.linalg.norm(nodes.xyz[nodes.index(node)] - nodes.xyz[nodes.index(other)], axis=1)
    reach = _largest(away, np.searchsorted(ids, node), ids.size)
    nearest = cKDTree(nodes.xyz[supports]).query(place)[0]
    return np.asarray(nearest <= (1 + _ONE_PLACE) * reach)


def _exchanged_around(
    body: FEModel, ids: NDArray[np.int64], A: sp.csc_array, found: RigidResidual
) -> NDArray[np.bool_]:
    """True for nodes (k,) whose forces under rotation vanish if two nodes that they couple are exchanged.

    Either node may be one that they do not couple: the place that makes the forces vanish is then that of some node.
    True, too, for nodes that couple too many others to try.
    """
    # Imported here: it loads libraries that a body without such nodes does not need.
    from scipy.spatial import cKDTree

    exchanged, full = np.zeros(ids.size, dtype=np.bool_), each_once(body.dofs.node[body.dofs.component > 0])
    rows = body.dofs.rows(full[:, None], np.arange(1, 4)).reshape(-1, 3)
    full, rows = (each[(rows >= 0).all(axis=1)] for each in (full, rows))
    if found.shapes.shape[1] < _ALL or not full.size:
        return exchanged
    shapes = found.shapes[rows][:, :, 3:]
    places, by_row = cKDTree(shapes.reshape(-1, 9)), sp.csr_array(A)
    limit = max(_NO_FORCE, _ROUNDINGS * body.rounding)
    for k in np.flatnonzero(np.isin(ids, full)):
        at = rows[np.searchsorted(full, ids[k])]
        own, force = by_row[at], found.force[at][:, 3:]
        coupled = each_once(body.dofs.node[own.indices])
        near = np.minimum(np.searchsorted(full, coupled), full.size - 1)
        near = near[full[near] == coupled]
        if near.size > _MOST_AROUND:
            exchanged[k] = True
            continue
        blocks = own[:, rows[near].ravel()].toarray().reshape(3, -1, 3).transpose(1, 0, 2)
        # Forces of the block of each node times the motion of another one in place of its own.
        by = blocks[:, None] @ shapes[near]
        none = limit * abs(by).max(axis=(2, 3)).diagonal().sum()
        if abs(force).max() <= none:
            continue
        by -= by.diagonal().transpose(2, 0, 1)[:, None]
        if (abs(force + by + by.swapaxes(0, 1)).max(axis=(2, 3)) <= none).any():
            exchanged[k] = True
            continue
        sure = np.linalg.cond(blocks) < _SURE
        wanted = shapes[near[sure]] - np.linalg.solve(blocks[sure], np.broadcast_to(force, (sure.sum(), 3, 3)))
        exchanged[k] = np.any(places.query(wanted.reshape(-1, 9))[0] <= _ONE_PLACE)
    return exchanged


def _as_spring(
    body: FEModel, found: RigidResidual, rows: NDArray[np.int64], of: NDArray[np.int64], limit: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """True for nodes whose forces under translation are those of a spring: symmetric, and none pushes.

    Rows of one node in another order load it as no spring does. ``rows`` and their nodes ``of`` are those of points,
    ``limit`` the forces that round-off may leave.
    """
    moving = body.dofs.component[rows] <= 3
    rows, of, count = rows[moving], of[moving], int(of.max(initial=-1)) + 1
    spring, along = np.zeros((2, count, 3, 3))
    axis = body.rigid_shapes[rows][:, :3, None]
    np.add.at(spring, of, axis * found.force[rows][:, None, :3])
    np.add.at(along, of, axis * axis.transpose(0, 2, 1))
    # A direction without a row has no force.
    spring = spring @ along
    off = np.maximum(_largest(limit[moving], of, count), _NO_FORCE * abs(spring).max(axis=(1, 2)))
    even = abs(spring - spring.transpose(0, 2, 1)).max(axis=(1, 2)) <= 2 * off
    least = np.linalg.eigvalsh((spring + spring.transpose(0, 2, 1)) / 2)[:, 0]
    return np.asarray(even & (least >= -2 * off))


def _without_rows(dofs: DofTable) -> DofTable | None:
    """Translations that no node has among its rows, of every node; None if some nodes have each."""
    ids = each_once(dofs.node[dofs.component > 0])
    none = np.setdiff1d([1, 2, 3], dofs.component).astype(np.int8)
    return DofTable(np.repeat(ids, none.size), np.tile(none, ids.size)) if none.size else None


def _in_plane(found: RigidResidual) -> RigidResidual | None:
    """Forces under the motions in a plane, by translation and rotation along each axis, zero for the other motions.

    None if the admissible motions are not those of a plane across an axis.
    """
    own = found.motions @ found.motions.T
    kept = own.diagonal() > 1 - _NO_FORCE
    aligned = abs(own - np.diag(kept.astype(np.float64))).max() <= _NO_FORCE
    if not aligned or np.count_nonzero(kept[:3]) != 2 or not kept[3:][~kept[:3]].all():
        return None
    return replace(found, motions=np.diag(kept.astype(np.float64)), force=found.force @ found.motions.T)


def _any(rows: NDArray[np.bool_], of: NDArray[np.int64], count: int) -> NDArray[np.bool_]:
    """Nodes with a row in a set of rows."""
    return np.asarray(np.bincount(of[rows], minlength=count) > 0)


def _largest(value: NDArray[np.float64], of: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    top = np.zeros(count)
    np.maximum.at(top, of, value)
    return top


def _whole(body: FEModel, ids: NDArray[np.int64], A: sp.csc_array) -> NDArray[np.bool_]:
    """Nodes that have the same components as all nodes that a matrix couples them with, and no constraint."""
    kind = np.zeros(ids.size, dtype=np.int64)
    moving = body.dofs.component > 0
    of = np.searchsorted(ids, body.dofs.node[moving])
    np.add.at(kind, of, 1 << body.dofs.component[moving].astype(np.int64))
    if body.constrained is not None:
        kind[np.isin(ids, body.constrained.node)] = -1
    rows = np.flatnonzero(moving)
    A = sp.csc_array(A[rows][:, rows])
    first, second = of[A.indices], of[np.repeat(np.arange(rows.size), np.diff(A.indptr))]
    return (kind >= 0) & ~_any((kind[first] != kind[second]) & (A.data != 0), first, ids.size)
