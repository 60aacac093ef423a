"""Motions of a body that neither stiffness nor mass nor damping determines."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.linalg.eigen import stiffness_null_space
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.model import FEModel, Interface, rigid_body_shapes

__all__ = ["Determined", "hold_undetermined"]

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
# A pivot, or the force of a rotation, below so many roundings of the file is rounding.
_ROUNDINGS = 1e3
# Dofs named in a message.
_NAMED = 12


@dataclass(frozen=True, eq=False)
class Determined:
    """A body with stiffness, mass or damping in every motion.

    Parameters
    ----------
    body : FEModel
        n dofs; the dofs held are in ``constrained``, or have springs to the rest of the body.
    motions : (n, k) csc array
        Undetermined motions of the remaining dofs. A force or sensor along such a motion has no meaning: its response
        would depend on the choice of the dofs held.
    held : tuple of str
        Labels of the dofs held.
    lost : tuple of (str, tuple of str)
        Interfaces that lose some dofs, and the labels of these dofs.
    """

    body: FEModel
    motions: sp.csc_array
    held: tuple[str, ...] = ()
    lost: tuple[tuple[str, tuple[str, ...]], ...] = ()

    @property
    def note(self) -> str:
        """Dofs held, in words; empty without any."""
        if not self.held:
            return ""
        text = f"{self.body.name}: neither stiffness nor mass determines {len(self.held)} motions; held: "
        text += _listed(self.held)
        text += "".join(f"; interface '{name}' loses {_listed(labels)}" for name, labels in self.lost)
        if any(source.holds.startswith("stiffness KGG") for source in self.body.sources):
            # Where plates are not quite flat, such a rotation is as soft as rounding, and changes modes.
            text += ". NASTRAN holds rotations about normals of plates in KAA and not in KGG: give KAA and MAA"
        return text

    @property
    def moved(self) -> NDArray[np.bool_]:
        """Rows of the body that an undetermined motion moves (n,)."""
        return _moved(self.motions)

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
        along, size = _largest(sp.csr_array(rows @ self.motions)), _largest(self.motions)
        at = int(along.argmax())
        if along[at] > _AT_REST * float(size.max(initial=0.0)) * float(abs(rows[[at]]).max()):
            part = abs(rows[[at]].toarray()[0]) * size
            advice = "give these dofs inertia, hold them by a constraint, or take another node"
            nodes, faces = self.body.dofs.node, self.body.interfaces.values()
            # The points that faces are tied to may be all that rests.
            others = np.setdiff1d(nodes, [node for face in faces for node in face.node])
            if others.size and np.isin(others, nodes[self.moved]).all():
                advice = (
                    "no node beside its interfaces is at rest in it. Solids of reduced integration in a row of one, as "
                    "C3D20R, leave such motions: mesh two across, or take elements of full integration"
                )
            raise SceneError(
                f"body '{self.body.name}': {what} at {self.body.dofs.labels[int(part.argmax())]} moves with "
                f"{_listed(self.held)} in a motion that has neither stiffness nor mass, so it has no answer; {advice}"
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
        return Determined(body, sp.csc_array((body.n, 0)))
    still, single, motions, scale = _undetermined_motions(body)
    if not still.size and not motions.shape[1]:
        return Determined(body, single)
    # With orthonormal vectors in scaled dofs, the share of each dof does not depend on the choice of vectors.
    scaled = la.orth(motions * scale[:, None]) if motions.shape[1] else motions
    share = np.linalg.norm(scaled, axis=1)
    moved = _moved(single) | (share > _AT_REST * share.max())
    moved[still] = True
    faces, lost = {}, []
    for name, face in body.interfaces.items():
        faces[name], labels = _without(body, face, moved, name in named)
        if labels:
            lost.append((name, labels))
    held = still
    if motions.shape[1]:
        _, order = la.qr(scaled.T, mode="r", pivoting=True)
        chosen = np.asarray(order[: motions.shape[1]], dtype=np.int64)
        held = np.union1d(held, chosen)
        springs = _springs_to_the_rest(body, motions, chosen, moved)
        still, body = (held, body) if springs is None else (still, replace(body, K=sp.csc_array(body.K + springs)))
    stay = np.setdiff1d(np.arange(body.n, dtype=np.int64), still)
    labels_held = tuple(body.dofs.labels[row] for row in held)
    left = sp.csc_array(sp.hstack([single, sp.csc_array(motions)]))[stay]
    left = left[:, np.flatnonzero(np.diff(left.indptr))]
    return Determined(_restricted(body, stay, still, faces), left, labels_held, tuple(lost))


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
) -> tuple[NDArray[np.int64], sp.csc_array, NDArray[np.float64], NDArray[np.float64]]:
    """Null space of K, M and D together.

    Returns
    -------
    still : (h,) int64
        Empty rows, and a row of each motion of one node.
    single : (n, s) csc array
        Rotations of one node each, about any axis: a shell may have thousands.
    motions : (n, k) float64
        Motions of the other dofs.
    scale : (n,) float64
        Scale of each dof, which makes translations and rotations comparable.
    """
    A = _sum(body)
    diagonal = A.diagonal()
    still = np.flatnonzero(diagonal == 0)
    scale = np.sqrt(np.where(diagonal == 0, 1.0, diagonal))
    single, motions = sp.csc_array((body.n, 0)), np.zeros((body.n, 0))
    if _is_sound(A, still, body.stiffness_rounding):
        return still, single, motions, scale
    turned, single = _single_turns(A, body)
    still = np.union1d(still, turned)
    if not turned.size or not _is_sound(A, still, body.stiffness_rounding):
        rest = np.setdiff1d(np.arange(body.n), still)
        found = stiffness_null_space(sp.csc_array(A[rest][:, rest]), body.stiffness_rounding)
        motions = np.zeros((body.n, found.shape[1]))
        motions[rest] = found
    sizes = sp.diags_array(1 / np.sqrt(np.asarray((sp.diags_array(scale) @ single).power(2).sum(axis=0)).ravel()))
    return still, sp.csc_array(single @ sizes), motions / np.linalg.norm(motions * scale[:, None], axis=0), scale


def _is_sound(A: sp.csc_array, still: NDArray[np.int64], rounding: float) -> bool:
    """True if a factorisation shows that a matrix without some rows has no null space."""
    rest = np.setdiff1d(np.arange(A.shape[0]), still)
    try:
        return bool(factorise(sp.csc_array(A[rest][:, rest])).weakest[1] > max(_SOUND_PIVOT, _ROUNDINGS * rounding))
    except NotPositiveDefiniteError:
        return False


def _single_turns(A: sp.csc_array, body: FEModel) -> tuple[NDArray[np.int64], sp.csc_array]:
    """Rotations (n, s) of single nodes that a matrix does not resist, and the row (s,) that each moves most."""
    rows = body.dofs.rows(body.dofs.node_ids[:, None], [4, 5, 6]).reshape(-1, 3)
    rows = rows[(rows >= 0).all(axis=1)]
    of, place = np.full(body.n, -1), np.zeros(body.n, dtype=np.int64)
    of[rows], place[rows] = np.arange(len(rows))[:, None], np.arange(3)
    entries = sp.coo_array(A)
    i, j = entries.row, entries.col
    own = (of[i] >= 0) & (of[i] == of[j])
    blocks = np.zeros((len(rows), 3, 3))
    blocks[of[i[own]], place[i[own]], place[j[own]]] = entries.data[own]
    weight, axes = np.linalg.eigh(blocks)
    limit = _ROUNDINGS * body.stiffness_rounding
    weak = np.flatnonzero((weight[:, 0] <= limit * weight[:, 2]) & (weight[:, 2] > 0))
    k, axis = np.arange(weak.size), axes[weak, :, 0]
    turns = sp.csc_array((axis.ravel(), (rows[weak].ravel(), np.repeat(k, 3))), shape=(body.n, weak.size))
    least = 1 / np.sqrt(np.where(A.diagonal() > 0, A.diagonal(), np.inf))
    force = _largest(sp.csr_array((sp.diags_array(least) @ A @ turns).T))
    free = force <= limit * np.sqrt(weight[weak, 2])
    return rows[weak, abs(axis).argmax(axis=1)][free], turns[:, free]


def _largest(A: sp.csr_array | sp.csc_array) -> NDArray[np.float64]:
    """Largest size in each row."""
    entries = sp.coo_array(A)
    found = np.zeros(A.shape[0])
    np.maximum.at(found, entries.row, abs(entries.data))
    return found


def _moved(motions: sp.csc_array) -> NDArray[np.bool_]:
    """True for the rows that motions (n, k) move."""
    size = _largest(motions)
    return np.asarray(size > _AT_REST * size.max(initial=0.0))


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
