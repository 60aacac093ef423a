"""Bodies in several pieces, and motions that neither stiffness nor mass nor damping determines."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.linalg.eigen import stiffness_null_space
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.model import FEModel, Interface, rigid_body_shapes

__all__ = ["Determined", "check_connected", "hold_undetermined", "parts"]

# A singular matrix has a pivot of the size of the rounding of its diagonal entry; above this one, no search is needed.
_SOUND_PIVOT = 1e-6
# Relative to the largest motion: dofs that move less are at rest, and so is a mass whose momentum is less.
_AT_REST = 1e-6
# Least pivot, relative to the largest, of six translations that determine a rigid motion: along a line there are five,
# and coordinates of seven digits leave the sixth a pivot of 1e-7.
_INDEPENDENT = 1e-6
# Of the stiffness of the dof that a spring holds: firm beside the rounding, and soft beside the body.
_SPRING = 1e-3
# Rigid motions of a body that is free in all directions.
_ALL_MOTIONS = 6
# Dofs and parts named in a message.
_NAMED, _NAMED_PARTS = 12, 5


def parts(body: FEModel) -> NDArray[np.int64]:
    """Number of the part of each row (n,); rows of one node are one part."""
    # Three partitions of the rows, whose classes are joined where they share a row: by K, by M, and by node.
    classes = [_connected(body.K), _connected(body.M), np.unique(body.dofs.node, return_inverse=True)[1]]
    starts = np.cumsum([0, *(label.max(initial=-1) + 1 for label in classes)])
    first = np.tile(classes[0], 2)
    second = np.concatenate([classes[1] + starts[1], classes[2] + starts[2]])
    shared = sp.coo_array((np.ones(first.size), (first, second)), shape=(starts[-1], starts[-1]))
    _, label = csgraph.connected_components(shared, directed=False)
    return np.asarray(label[classes[0]], dtype=np.int64)


def _connected(A: sp.csc_array) -> NDArray[np.int64]:
    """Number of the connected part of each row of a symmetric matrix (n,)."""
    if not A.data.all():
        A = A.copy()
        A.eliminate_zeros()
    # The transpose is the same matrix stored by rows. Its strong components need no second copy by columns.
    return np.asarray(csgraph.connected_components(A.T, directed=True, connection="strong")[1], dtype=np.int64)


def check_connected(body: FEModel, proven: NDArray[np.float64] | None = None) -> None:
    """Refuse a body in several pieces, or with rows that have neither stiffness nor mass.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Its rigid motions, if K resists all others.

    Raises
    ------
    MatrixError
        Names a node of every piece.
    """
    # Each piece would have the rigid motions of its own nodes: three of one node, five or more of others.
    nodes, moving = np.unique(body.dofs.node).size, (body.dofs.component > 0) & (body.dofs.component <= 3)
    if proven is not None and proven.shape[1] == _ALL_MOTIONS and nodes > 2 and moving.sum() == 3 * nodes:
        return
    empty = np.flatnonzero(_without_entries(body.K) & _without_entries(body.M))
    if empty.size:
        raise MatrixError(
            f"body '{body.name}': {empty.size} dofs have neither stiffness nor mass, the first is "
            f"{body.dofs.labels[empty[0]]}; write the matrices without them, or take their rows out"
        )
    part = parts(body)
    count = int(part.max()) + 1
    if count > 1 and all(np.array_equal(A.nonzero()[0], A.nonzero()[1]) for A in (body.K, body.M)):
        raise MatrixError(
            f"body '{body.name}': stiffness and mass are diagonal, {body.n} x {body.n}, so they are modal matrices and "
            "no dofs of nodes. Give them with their shapes: `modes: {stiffness: ..., mass: ..., shapes: ...}`"
        )
    if count > 1:
        sizes = np.bincount(part)
        order = np.argsort(-sizes)
        named = [
            f"{len(np.unique(body.dofs.node[part == p]))} nodes around node {body.dofs.node[part == p][0]}"
            for p in order[:_NAMED_PARTS]
        ]
        raise MatrixError(
            f"body '{body.name}' is not one piece: {count} parts share neither stiffness nor mass "
            f"({'; '.join(named)}{' ...' if count > _NAMED_PARTS else ''}). Look for missing elements or unmerged "
            "nodes, or make each part a component of its own"
        )


def _without_entries(A: sp.csc_array) -> NDArray[np.bool_]:
    """True for each column of zeros (n,)."""
    filled = np.concatenate([[0], np.cumsum(A.data != 0)])[A.indptr]
    return np.asarray(np.diff(filled) == 0)


@dataclass(frozen=True, eq=False)
class Determined:
    """A body with stiffness, mass or damping in every motion.

    Parameters
    ----------
    body : FEModel
        n dofs; the dofs held are in ``constrained``, or have springs to the rest of the body.
    motions : (n, k) float64
        Undetermined motions of the remaining dofs. A force or sensor along such a motion has no meaning: its response
        would depend on the choice of the dofs held.
    held : tuple of str
        Labels of the dofs held.
    lost : tuple of (str, tuple of str)
        Interfaces that lose some dofs, and the labels of these dofs.
    """

    body: FEModel
    motions: NDArray[np.float64]
    held: tuple[str, ...] = ()
    lost: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def note(self) -> str:
        """Dofs held, in words; empty without any."""
        if not self.held:
            return ""
        text = f"{self.body.name}: neither stiffness nor mass determines {len(self.held)} motions; held: "
        text += _listed(self.held)
        return text + "".join(f"; interface '{name}' loses {_listed(labels)}" for name, labels in self.lost)

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Rows of the body that an undetermined motion moves (n,)."""
        size = abs(self.motions).max(axis=1, initial=0.0)
        return np.asarray(size > _AT_REST * size.max(initial=0.0))

    def check_untouched(self, rows: sp.csr_array, what: str) -> None:
        """Refuse actuators, sensors and loads along an undetermined motion.

        Parameters
        ----------
        rows : (p, n) sparse array
            Directions of the actuators, sensors or loads.
        what : str
            Their name in the message.

        Raises
        ------
        SceneError
            Names a dof.
        """
        if not self.motions.shape[1] or not rows.shape[0]:
            return
        along = abs(rows @ self.motions).max(axis=1)
        at = int(along.argmax())
        if along[at] > _AT_REST * float(abs(self.motions).max(initial=0.0)) * float(abs(rows[[at]]).max()):
            part = abs(rows[[at]].toarray()[0]) * abs(self.motions).max(axis=1)
            raise SceneError(
                f"body '{self.body.name}': {what} at {self.body.dofs.labels[int(part.argmax())]} moves with "
                f"{_listed(self.held)} in a motion that has neither stiffness nor mass, so it has no answer; give "
                "these dofs inertia, hold them by a constraint, or take another node"
            )


def hold_undetermined(
    body: FEModel, named: Collection[str] = (), proven: NDArray[np.float64] | None = None
) -> Determined:
    """Hold one dof for each motion that has neither stiffness nor mass nor damping, as AUTOSPC does.

    Examples are dofs with empty rows, and motions of several dofs: rotations about a skew axis, or of a chain of bars
    without torsional inertia about itself. A dof with stiffness and without mass stays.

    Parameters
    ----------
    body : FEModel
        n dofs.
    named : collection of str
        Interfaces with dofs that the user has listed.
    proven : (n, r) float64, optional
        All motions without stiffness, if known: if they have mass, every motion is determined.

    Returns
    -------
    Determined

    Raises
    ------
    MatrixError
        If the body has no mass at all.
    SceneError
        If an interface would lose a listed dof, or all its dofs.

    Notes
    -----
    The motions are the common null space of K, M and D, which is the null space of their sum. An interface loses the
    dofs that such a motion moves: otherwise these dofs would pass the load of the joint to the ground.
    """
    if not body.M.diagonal().any():
        raise MatrixError(f"body '{body.name}' has no mass: all entries of M are zero; name its mass matrix")
    if proven is not None and np.linalg.matrix_rank(proven.T @ (body.M @ proven), hermitian=True) == proven.shape[1]:
        return Determined(body, np.empty((body.n, 0)))
    empty, motions, scale = _undetermined_motions(body)
    if not empty.any() and not motions.shape[1]:
        return Determined(body, motions)
    # With orthonormal vectors in scaled dofs, the share of each dof does not depend on the choice of vectors.
    scaled = la.orth(motions * scale[:, None]) if motions.shape[1] else motions
    share = np.linalg.norm(scaled, axis=1)
    moved = empty | (share > _AT_REST * share.max())
    faces, lost = {}, []
    for name, face in body.interfaces.items():
        faces[name], labels = _without(body, face, moved, name in named)
        if labels:
            lost.append((name, labels))
    held = still = np.flatnonzero(empty)
    if motions.shape[1]:
        _, order = la.qr(scaled.T, mode="r", pivoting=True)
        chosen = np.asarray(order[: motions.shape[1]], dtype=np.int64)
        held = np.union1d(held, chosen)
        springs = _springs_to_the_rest(body, motions, chosen, moved)
        still, body = (held, body) if springs is None else (still, replace(body, K=sp.csc_array(body.K + springs)))
    stay = np.setdiff1d(np.arange(body.n, dtype=np.int64), still)
    labels_held = tuple(body.dofs.labels[row] for row in held)
    return Determined(_restricted(body, stay, still, faces), motions[stay], labels_held, tuple(lost))


def _springs_to_the_rest(
    body: FEModel, motions: NDArray[np.float64], chosen: NDArray[np.int64], moved: NDArray[np.bool_]
) -> sp.csc_array | None:
    """Springs (n, n) that hold dofs against the rigid motion of the rest of the body, and carry no force.

    Held to the ground, a rotation of a point on a massless arm would leave its translation the motion of the end of the
    arm: it has mass, and rigid motions by the geometry are then none of the body. None where no mass is left to what
    moves, and where six translations of the rest do not determine its rigid motions.
    """
    rest = np.setdiff1d(np.arange(body.n), chosen)
    M, N = sp.csc_array(body.M[rest][:, rest]), (motions * moved[:, None])[rest]
    if body.nodes is None or (abs(M @ N) <= _AT_REST * (abs(M) @ abs(N))).all():
        return None
    centre = body.nodes.xyz.mean(axis=0)
    length = float(np.linalg.norm(body.nodes.xyz - centre, axis=1).max()) or 1.0
    R = rigid_body_shapes(body.dofs, body.nodes, centre) / np.repeat([1.0, length], 3)
    others = np.flatnonzero(~moved & (body.dofs.component > 0) & (body.dofs.component <= 3))
    if others.size < _ALL_MOTIONS:
        return None
    factor, order = la.qr(R[others].T, mode="r", pivoting=True)
    if abs(factor[-1, _ALL_MOTIONS - 1]) <= _INDEPENDENT * abs(factor[0, 0]):
        return None
    six = others[order[:_ALL_MOTIONS]]
    k = chosen.size
    columns = np.hstack([chosen[:, None], np.tile(six, (k, 1))])
    share = np.hstack([np.ones((k, 1)), -np.linalg.solve(R[six].T, R[chosen].T).T])
    rows = np.repeat(np.arange(k), columns.shape[1])
    apart = sp.csr_array((share.ravel(), (rows, columns.ravel())), shape=(k, body.n))
    size = sp.diags_array(_SPRING * body.K.diagonal()[chosen])
    return sp.csc_array(apart.T @ size @ apart)


def _undetermined_motions(
    body: FEModel,
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
    """Null space of K, M and D together: empty rows (n,), motions of the other dofs (n, k), and their scale (n,).

    The scale makes translations and rotations comparable.
    """
    A = _sum(body)
    empty = A.diagonal() == 0
    rest = np.flatnonzero(~empty)
    inner = sp.csc_array(A[rest][:, rest])
    try:
        sound = factorise(inner).weakest[1] > max(_SOUND_PIVOT, 1e3 * body.stiffness_rounding)
    except NotPositiveDefiniteError:
        sound = False
    found = np.empty((rest.size, 0)) if sound else stiffness_null_space(inner, body.stiffness_rounding)
    motions = np.zeros((body.n, found.shape[1]))
    motions[rest] = found
    scale = np.ones(body.n)
    scale[rest] = np.sqrt(inner.diagonal())
    return empty, motions / np.linalg.norm(motions * scale[:, None], axis=0), scale


def _sum(body: FEModel) -> sp.csc_array:
    """K + s M + t D, with factors for diagonals of similar size."""
    A, size = body.K, body.K.diagonal()
    for B in (body.M, body.D):
        if B is None:
            continue
        both = (size > 0) & (B.diagonal() > 0)
        ratio = float(np.median(size[both] / B.diagonal()[both])) if both.any() else 1.0
        A = A + ratio * B
    return sp.csc_array(A)


def _without(
    body: FEModel, face: Interface, moved: NDArray[np.bool_], named: bool
) -> tuple[Interface, tuple[str, ...]]:
    """An interface without the dofs that undetermined motions move, and the labels of these."""
    left, labels = [], []
    for node, components in zip(face.node, face.components, strict=True):
        rows = body.dofs.rows_of(int(node), components)
        left.append(tuple(c for c, row in zip(components, rows, strict=True) if not moved[row]))
        labels += [body.dofs.labels[row] for row in rows if moved[row]]
        if labels and (named or not left[-1]):
            why = "its `dofs:` name" if named else "no other dof is left of a node at"
            raise SceneError(
                f"body '{body.name}', interface '{face.name}': {why} {_listed(labels)}, which move without stiffness "
                "or mass and so can carry no load; leave these dofs out of `dofs:` and free them in the joint, or give "
                "them stiffness or inertia in the model"
            )
    return replace(face, components=tuple(left)), tuple(labels)


def _restricted(
    body: FEModel, stay: NDArray[np.int64], held: NDArray[np.int64], faces: dict[str, Interface]
) -> FEModel:
    """The body without the rows held."""
    place = np.full(body.n, -1)
    place[stay] = np.arange(stay.size)
    at_rest = body.dofs[held]
    return replace(
        body,
        K=body.K[stay][:, stay],
        M=body.M[stay][:, stay],
        D=None if body.D is None else body.D[stay][:, stay],
        dofs=body.dofs[stay],
        interfaces=faces,
        sets={name: place[rows][place[rows] >= 0] for name, rows in body.sets.items()},
        constrained=at_rest if body.constrained is None else body.constrained.joined(at_rest),
        tied=body.tied and replace(body.tied, leads=body.dofs[stay], T=body.tied.T[:, stay]),
        second_order=body.second_order and body.second_order.of(np.eye(body.n)[:, stay]),
        terms=tuple(replace(term, matrix=sp.csc_array(term.matrix)[stay][:, stay]) for term in body.terms),
    )


def _listed(labels: Collection[str]) -> str:
    return ", ".join(list(labels)[:_NAMED]) + (" ..." if len(labels) > _NAMED else "")
