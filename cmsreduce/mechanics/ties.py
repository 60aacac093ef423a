"""Ties of the nodes of an interface to one point with six dofs: rigid, or with the average motion of the nodes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.sparse import principal_part
from cmsreduce.model import (
    DOUBLE,
    DofTable,
    FEModel,
    Interface,
    Nodes,
    Recovery,
    UntiedMass,
    cross_matrix,
    rigid_body_shapes,
)

__all__ = ["Tie", "tie_nodes"]

# Nodes with less spread across a line, relative to that along it, are in line. Their rotation about it is that much
# smaller than their other motions, and its square of the digits of the stiffness is lost: half of them remain here.
_IN_LINE = 1e-4
_SIX = np.arange(1, 7, dtype=np.int8)
_TRANSLATIONS = (1, 2, 3)
_NAMED = 8
# Of the terms of a sum that cancel, in roundings of the largest.
_ROUNDINGS = 4.0


@dataclass(frozen=True, eq=False)
class Tie:
    """Tie of the nodes of an interface to one point.

    Parameters
    ----------
    kind : {"rigid", "average"}
        ``rigid``: the nodes follow the point as a rigid body (RBE2). ``average``: the point follows the average motion
        of the nodes, without stiffening them (RBE3).
    position : (3,) float64, optional
        Place of the point, in the body's basic frame and unit of length; by default the centroid of the nodes.
    weights : tuple of float, optional
        Weights of the nodes in the average; by default all equal.
    frame : (3, 3) float64, optional
        Axes of the point as rows, in basic; by default basic.
    """

    kind: Literal["rigid", "average"]
    position: NDArray[np.float64] | None = None
    weights: tuple[float, ...] | None = None
    frame: NDArray[np.float64] | None = None


def tie_nodes(body: FEModel, name: str, tie: Tie) -> FEModel:
    """Tie the nodes of an interface to a new node, which becomes the interface.

    The body is written in new dofs x' with x = T x', by congruence: K' = T^T K T, and M and D in the same way.

    Parameters
    ----------
    body : FEModel
        Body with the interface ``name``: the nodes to tie, with the components that follow the point.
    name : str
        Name of the interface.
    tie : Tie
        Kind, place, weights and axes.

    Returns
    -------
    FEModel
        With a node of the next free id and dofs 123456. The dofs that follow have no rows; they are in ``tied``.

    Raises
    ------
    SceneError
        If the nodes leave a rotation of the point undetermined, or one of them belongs to another interface.

    Notes
    -----
    ``rigid``: x_tied = R x_point. ``average``: x_point = A x_nodes with A = (R^T W R)^-1 R^T W over the translations of
    the nodes, the least-squares rigid motion. The dofs of the point replace six translations, taken by pivoted QR of A,
    x_6 = A_6^-1 (x_point - A_rest x_rest), so that no dof is lost and nothing is stiffened. A force on the point acts
    on the nodes as A^T f, which is statically equivalent.
    """
    where, face = f"body '{body.name}', interface '{name}'", body.interfaces[name]
    nodes = body.nodes
    if nodes is None:
        raise SceneError(f"{where}: nodes are tied by their coordinates; give `geometry:`")
    _check_free(where, body, face)
    at = nodes.xyz[nodes.index(face.node)]
    axes = np.eye(3) if tie.frame is None else tie.frame
    rows = _rigid_rows(where, body, face) if tie.kind == "rigid" else _translations(where, body, face)
    weights = np.ones(face.node.size) if tie.weights is None else np.asarray(tie.weights, dtype=np.float64)
    if weights.size != face.node.size or not (weights > 0).all():
        raise SceneError(f"{where}: {face.node.size} nodes need as many positive weights, found {list(weights)}")
    centre = weights @ at / weights.sum()
    length = float(np.linalg.norm(at - centre, axis=1).max()) or 1.0
    position = at.mean(axis=0) if tie.position is None else np.asarray(tie.position, dtype=np.float64)
    # Motion of the point, in its frame, from the motion of the centre, with rotations scaled to displacements.
    G = np.eye(6)
    G[:3, 3:] = -cross_matrix(position - centre)
    G = np.kron(np.eye(2), axes) @ G / np.repeat([1.0, length], 3)
    R = _shapes(body, rows, centre) / np.repeat([1.0, length], 3)
    _check_determined(where, body, face, rows, R, centre, length, tie.kind)
    if tie.kind == "rigid":
        T = _transformation(body.n, rows, R @ np.linalg.inv(G), np.zeros((rows.size, 0)), rows[:0])
        gone = rows
    else:
        spread = R * np.repeat(weights, 3)[:, None]
        A = np.linalg.solve(R.T @ spread, spread.T)
        _, order = la.qr(A, mode="r", pivoting=True)
        six, rest = order[:6], order[6:]
        follow = np.linalg.solve(A[:, six], np.hstack([np.linalg.inv(G), -A[:, rest]]))
        gone = rows[six]
        T = _transformation(body.n, gone, follow[:, :6], follow[:, 6:], rows[rest])
    free_id = max(int(nodes.id.max()), int(body.recovery.dofs.node.max())) + 1
    return _restated(body, T, gone, name, Nodes(np.array([free_id]), position[None], axes[None]))


def _check_free(where: str, body: FEModel, face: Interface) -> None:
    """Refuse nodes of another interface, and nodes that are tied already."""
    for other in body.interfaces.values():
        both = np.intersect1d(face.node, other.node)
        if other.name != face.name and both.size:
            raise SceneError(
                f"{where}: nodes {_listed(both)} are tied here and belong to interface '{other.name}' too; a tied node "
                "follows one point only. Take them out of one of the two"
            )
    if body.tied is not None and np.isin(face.node, body.tied.dofs.node).any():
        twice = np.intersect1d(face.node, body.tied.dofs.node)
        raise SceneError(f"{where}: nodes {_listed(twice)} are tied already; a node follows one point only")


def _rigid_rows(where: str, body: FEModel, face: Interface) -> NDArray[np.int64]:
    """Rows that follow the point; every node needs the same translations, or one would be tied and held at once."""
    moved = [set(_TRANSLATIONS) & set(parts) for parts in face.components]
    all_of_them = set().union(*moved)
    lacking = face.node[[parts != all_of_them for parts in moved]]
    if lacking.size:
        raise SceneError(
            f"{where}: nodes {_listed(lacking)} lack translations that others have, as if they were constrained, and "
            "cannot follow a rigid body; leave them out, or name `dofs:` that all of them have"
        )
    return body.interface_rows(face.name)


def _translations(where: str, body: FEModel, face: Interface) -> NDArray[np.int64]:
    """Rows of all translations of the nodes."""
    rows = body.dofs.rows(np.repeat(face.node, 3), np.tile(_TRANSLATIONS, face.node.size))
    lacking = face.node[(rows.reshape(-1, 3) < 0).any(axis=1)]
    if lacking.size:
        raise SceneError(
            f"{where}: an average needs the translations 123 of every node, but nodes {_listed(lacking)} lack some in "
            "the matrices; leave them out, or use `tie: rigid`"
        )
    return rows


def _shapes(body: FEModel, rows: NDArray[np.int64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    assert body.nodes is not None
    return rigid_body_shapes(body.dofs[rows], body.nodes, centre)


def _check_determined(
    where: str,
    body: FEModel,
    face: Interface,
    rows: NDArray[np.int64],
    R: NDArray[np.float64],
    centre: NDArray[np.float64],
    length: float,
    kind: str,
) -> None:
    """Refuse nodes that leave a rigid motion of the point undetermined."""
    every = np.flatnonzero(body.dofs.component > 0)
    of_body = _shapes(body, every, centre) / np.repeat([1.0, length], 3)
    # As displacements at the length of the face, so that no unit of length decides.
    of_body, R = (
        A * np.where(body.dofs.component[rows] > 3, length, 1.0)[:, None] for A, rows in ((of_body, every), (R, rows))
    )
    _, size, motions = svd(of_body, full_matrices=False)
    # Least squares need all six; a rigid tie leaves out what the body does not have.
    motions = motions if kind == "average" else motions[size > _IN_LINE * size.max()]
    if la.svdvals(R @ motions.T).min() > _IN_LINE and R.shape[0] >= len(motions):
        return
    assert body.nodes is not None
    at = body.nodes.xyz[body.nodes.index(face.node)] - centre
    spread = la.svdvals(at)
    alike = "coincide" if spread[0] <= _IN_LINE * float(abs(body.nodes.xyz).max()) else "are in line"
    if at.shape[0] > 2 and spread[1] > _IN_LINE * spread[0]:
        alike = "have too few dofs"
    tied = f"nodes {_listed(face.node)} {alike}" if at.shape[0] > 1 else f"node {face.node[0]} is alone"
    raise SceneError(
        f"{where}: {tied}, which leaves a rotation of the tied point undetermined; tie three nodes or more that are "
        "not in line, or nodes with rotations (`tie: rigid`)"
    )


def _transformation(
    n: int,
    gone: NDArray[np.int64],
    by_point: NDArray[np.float64],
    by_rest: NDArray[np.float64],
    rest: NDArray[np.int64],
) -> sp.csr_array:
    """T of x = T x': identity on the rows that stay, then six columns of the point.

    by_point : (gone, 6) and by_rest : (gone, rest) give the motion of the rows that go, for unit motions of the point
    and of the rows ``rest``.
    """
    stay = np.delete(np.arange(n), gone)
    place = np.full(n, -1)
    place[stay] = np.arange(stay.size)
    columns = np.concatenate([stay.size + np.arange(6), place[rest]])
    follow = np.hstack([by_point, by_rest])
    # Long indices would pass to every product with it, and so to the matrices of the body.
    i = np.concatenate([stay, np.repeat(gone, columns.size)]).astype(np.int32)
    j = np.concatenate([np.arange(stay.size), np.tile(columns, gone.size)]).astype(np.int32)
    T = sp.csr_array((np.concatenate([np.ones(stay.size), follow.ravel()]), (i, j)), shape=(n, stay.size + 6))
    T.eliminate_zeros()
    return T


def _restated(body: FEModel, T: sp.csr_array, gone: NDArray[np.int64], name: str, point: Nodes) -> FEModel:
    """The body in the new dofs x'."""
    assert body.nodes is not None
    stay = np.delete(np.arange(body.n), gone)
    place = np.full(body.n, -1)
    place[stay] = np.arange(stay.size)
    every, dofs = body.recovery, body.dofs[stay].joined(DofTable(np.repeat(point.id, 6), _SIX))
    K = _without_noise(_congruent(body.K, T, stay, gone), body, T, gone)
    M = _without_round_off(_congruent(body.M, T, stay, gone), body, T, gone)
    D = None if body.D is None else _congruent(body.D, T, stay, gone)
    follow = np.concatenate([gone, np.arange(body.n, len(every.dofs))])
    sets = {label: place[rows] for label, rows in body.sets.items() if (place[rows] >= 0).all()}
    return replace(
        body,
        K=K,
        M=M,
        D=D,
        dofs=dofs,
        nodes=replace(
            body.nodes,
            id=np.append(body.nodes.id, point.id),
            xyz=np.vstack([body.nodes.xyz, point.xyz]),
            frame=np.concatenate([body.nodes.frame, point.frame]),
        ),
        interfaces={
            **body.interfaces,
            name: Interface(name, point.id, (tuple(map(int, _SIX)),), point.xyz, point.frame[0], point.frame),
        },
        sets=sets,
        tied=Recovery(every.dofs[follow], dofs, every.T[follow] @ T),
        untied_mass=body.untied_mass or UntiedMass(body.dofs, body.M),
        second_order=None,
        # Symmetric to the last bit, as the matrices of the body are, which were checked.
        _sound=tuple(A for A in (K, M, D) if A is not None),
    )


def _congruent(A: sp.csc_array, T: sp.csr_array, stay: NDArray[np.int64], gone: NDArray[np.int64]) -> sp.csc_array:
    """T^T A T of a symmetric matrix, symmetric to the last bit.

    T is the identity on the rows that stay, so that their entries are copied, and products are those of the others.
    """
    m, follow = T.shape[1], T[gone]
    kept = _grown(principal_part(A, stay), m)
    moved = sp.csc_array(A[:, gone] @ follow)
    beside, own = _grown(moved[stay], m), follow.T @ moved[gone]
    changes = sp.csc_array(beside + beside.T + 0.5 * (own + own.T))
    changes.sum_duplicates()
    found = sp.csc_array(kept + changes)
    found.eliminate_zeros()
    return found


def _grown(A: sp.csc_array, m: int) -> sp.csc_array:
    """The matrix with empty rows and columns up to m of each."""
    indptr = np.append(A.indptr, np.full(m - A.shape[1], A.indptr[-1], dtype=A.indptr.dtype))
    return sp.csc_array((A.data, A.indices, indptr), shape=(m, m))


def _without_round_off(M: sp.csc_array, body: FEModel, T: sp.csr_array, gone: NDArray[np.int64]) -> sp.csc_array:
    """Mass after a tie, zero in the rows of the point whose inertia is nothing but round-off of terms that cancel.

    Round-off would be a light mass, with larger round-off of either sign beside it.
    """
    point = np.arange(M.shape[0] - 6, M.shape[0])
    own = _terms(body.M, T, gone, point)[:, point].diagonal()
    none = point[abs(M.diagonal()[point]) <= _ROUNDINGS * max(body.rounding, DOUBLE) * own]
    return _without_rows(M, none) if none.size else M


def _terms(A: sp.csc_array, T: sp.csr_array, gone: NDArray[np.int64], point: NDArray[np.int64]) -> sp.csr_array:
    """Absolute terms whose sums are the rows of the point in T^T A T: only rows that follow the point are in these."""
    return sp.csr_array(abs(T[gone][:, point]).T @ abs(A[:, gone]).T @ abs(T))


def _without_noise(K: sp.csc_array, body: FEModel, T: sp.csr_array, gone: NDArray[np.int64]) -> sp.csc_array:
    """Stiffness after a tie, zero in the rows of the point if rounding of the files explains all that they hold.

    The boundary of a superelement resists no rigid motion, and its modes are not coupled to it by stiffness. If one
    point moves all of the boundary, only noise is left, which would hold the body or push it.
    """
    point = np.arange(K.shape[0] - 6, K.shape[0])
    explained = body.stiffness_rounding * _terms(body.K, T, gone, point)
    if (abs(K[:, point].T) - explained).max() > 0:
        return K
    return _without_rows(K, point)


def _without_rows(A: sp.csc_array, rows: NDArray[np.int64]) -> sp.csc_array:
    """Symmetric matrix with zeros in some rows and columns."""
    kept = sp.diags_array((~np.isin(np.arange(A.shape[0]), rows)).astype(np.float64))
    cleaned = sp.csc_array(kept @ A @ kept)
    cleaned.eliminate_zeros()
    return cleaned


def _listed(nodes: NDArray[np.int64]) -> str:
    return ", ".join(map(str, nodes[:_NAMED])) + (" ..." if nodes.size > _NAMED else "")
