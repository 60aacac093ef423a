"""Interface loading: stiffness and mass of the neighbours of a body on its interfaces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.joints import first_motion, relative_motion
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.system import wire
from cmsreduce.errors import ConstraintError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import DEPENDENT, energy_parts, null_space, strain_pairs
from cmsreduce.model import (
    Configuration,
    FEModel,
    InterfaceLoading,
    Joint,
    Placement,
    Point,
    Scene,
    Substructure,
)

__all__ = [
    "_AS_BUILT",
    "grounded_rows",
    "joined_to",
    "joint_rows",
    "neighbour_loading",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Reference configuration: every joint at zero.
_AS_BUILT = Configuration("as built")
# A motion with less than this share of the mass and of the stiffness of the others has none.
_RESISTS = 1e-14
# Sets of dofs that are the same in any axes.
_COMPLETE = {frozenset({1, 2, 3}), frozenset({4, 5, 6}), frozenset(range(1, 7))}
# A motion that a joint locks is carried by the neighbour's coordinates to this share of the row.
_CARRIED = 1e-8


def joined_to(scene: Scene, body: str) -> dict[str, list[Joint]]:
    """Bodies that are joined to a body, each with the joints between them."""
    found: dict[str, list[Joint]] = {}
    for joint in scene.joints:
        ends = [joint.first.body, joint.second.body]
        if body in ends and ends[0] != ends[1]:
            ends.remove(body)
            found.setdefault(ends[0], []).append(joint)
    return found


def grounded_rows(body: FEModel, rows: Indices, scene: Scene) -> Indices:
    """Positions in the i-set of the dofs that the ground holds."""
    faces = [point.name for point in scene.ground if point.body == body.name]
    held = [row for face in faces for row in body.interface_rows(face)]
    return np.flatnonzero(np.isin(rows, held))


def joint_rows(
    here: Substructure, there: Substructure, joints: Iterable[Joint], ground: Iterable[Point], scene: Scene
) -> tuple[Array, Array]:
    """Constraints of joints between two bodies as built, and of the ground, without springs of the joints.

    Parameters
    ----------
    here, there : Substructure
        The two bodies, of m and p coordinates.
    joints : iterable of Joint
        Joints between them.
    ground : iterable of Point
        Interfaces of the two that are held to the ground.
    scene : Scene
        Placements of the bodies.

    Returns
    -------
    A_here : (c, m) float64
    A_there : (c, p) float64
        A_here x_here + A_there x_there = 0.
    """
    pair = replace(
        scene,
        bodies=(here.name, there.name),
        joints=tuple(replace(joint, elements=()) for joint in joints),
        configurations=(_AS_BUILT,),
        actuators=(),
        sensors=(),
        base=here.name,
        ground=tuple(ground),
        floating=(),
    )
    stack = PointStack({here.name: here, there.name: there})
    A = dense(stack.spread(wire(stack, pair, _AS_BUILT).A))
    return A[:, : here.m], A[:, here.m :]


def neighbour_loading(here: Substructure, others: Iterable[Substructure], scene: Scene) -> InterfaceLoading:
    """Stiffness and mass of the neighbours on the i-set of a body, joints as built and held (Benfield-Hruda).

    Parameters
    ----------
    here : Substructure
        The i-set of the body: its coordinates are the interface dofs.
    others : iterable of Substructure
        Neighbours, condensed to the dofs at which they are joined.
    scene : Scene
        Its joints.

    Raises
    ------
    ConstraintError
        If a neighbour cannot follow the body in a motion that the joint locks.

    Notes
    -----
    The neighbour loads every dof of the shared interface, also those that the joint leaves free: motors of the joint
    act there, and the basis has no static modes for their forces. The joint's own inertia is part of the loading, once;
    it moves with the first interface of the joint, whichever body has it. Springs of the joint are strained only where
    a motion remains free. With A_h x + A_t y = 0 the neighbour moves as y = -A_t^+ A_h x + N z, N the null space of
    A_t: a motion of the neighbour that the interface does not hold is a coordinate z of its own. Source: Benfield and
    Hruda (1971); theory section 2.
    """
    i = here.m
    K, M, parts = np.zeros((i, i)), np.zeros((i, i)), np.zeros(i)
    names = []
    joints_to = joined_to(scene, here.name)
    for there in others:
        joints = [_locked(joint, here, there) for joint in joints_to[there.name]]
        ground = [point for point in scene.ground if point.body == there.name]
        A_here, A_there = joint_rows(here, there, joints, ground, scene)
        follow = _least_squares(A_there, -A_here)
        missed = A_here + A_there @ follow
        if abs(missed).max(initial=0.0) > _CARRIED * abs(A_here).max(initial=0.0):
            raise ConstraintError(
                f"'{there.name}' cannot load '{here.name}': it cannot follow a motion of the interface that their "
                "joints lock, because it has no dofs there, or the ground or a second joint holds it. Free the motion "
                "in a joint, or use craig-bampton or macneal-rubin"
            )
        size = np.sqrt(energy_parts(dense(there.K), np.eye(there.m)) if there.parts is None else there.parts)
        free = _with_energy(there, null_space(A_there)[0], size)
        z = K.shape[0] - i
        shapes = np.zeros((there.m, K.shape[0] + free.shape[1]))
        shapes[:, :i], shapes[:, i + z :] = follow, free
        K, M = (
            np.pad(A, (0, free.shape[1])) + shapes.T @ (dense(part) @ shapes)
            for A, part in ((K, there.K), (M, there.M))
        )
        for stiffness, inertia, row in _elements(here, there, joints_to[there.name], shapes, scene):
            K, M = K + stiffness * np.outer(row, row), M + inertia * np.outer(row, row)
        parts = np.pad(parts, (0, free.shape[1])) + (abs(shapes).T @ size) ** 2
        names.append(there.name)
    return InterfaceLoading(K, M, tuple(names), _AS_BUILT.name, parts=parts)


def _elements(
    here: Substructure, there: Substructure, joints: Iterable[Joint], shapes: Array, scene: Scene
) -> Iterator[tuple[float, float, Array]]:
    """Springs and inertias of joints to a neighbour: stiffness, inertia, and the motion (i + z,) on which they act."""
    stack = PointStack({here.name: here, there.name: there})
    placed = {name: scene.placements.get(name, Placement()) for name in stack.substructures}
    for joint in joints:
        for element in joint.elements:
            rows = [
                relative_motion(stack, scene, placed, joint, element.dof),
                first_motion(stack, placed, joint, element.dof),
            ]
            across, first = _follow(dense(stack.spread(np.array(rows))), here.m, shapes)
            yield element.stiffness, 0.0, across
            yield 0.0, element.inertia, first


def _follow(rows: Array, i: int, shapes: Array) -> Array:
    """Rows over the i-set and the neighbour's own coordinates, where the neighbour follows the body."""
    return np.pad(rows[:, :i], ((0, 0), (0, shapes.shape[1] - i))) + rows[:, i:] @ shapes


def _locked(joint: Joint, here: Substructure, there: Substructure) -> Joint:
    """The joint with its free motions held, where both interfaces have the same dofs whatever their axes."""
    faces = [
        sub.interfaces[end.name] for sub in (here, there) for end in (joint.first, joint.second) if end.body == sub.name
    ]
    dofs = {frozenset(components) for face in faces for components in face.components}
    complete = len(dofs) == 1 and dofs <= _COMPLETE
    return joint.locked() if complete else joint


def _with_energy(there: Substructure, motions: Array, size: Array) -> Array:
    """Motions of a neighbour with mass or stiffness: the spin of a rod about its own axis has neither.

    The rounding of its stiffness is a share of ``size`` (p,), the root of the parts of each coordinate's strain energy.
    """
    energy = np.zeros((motions.shape[1], motions.shape[1]))
    strain, X = strain_pairs(motions.T @ (dense(there.K) @ motions), (abs(motions).T @ size) ** 2)
    back = la.inv(X) if X.size else X
    for part in (back.T @ (strain[:, None] * back), motions.T @ (dense(there.M) @ motions)):
        energy += part / (float(np.trace(part)) or 1.0)
    weight, V = la.eigh(energy) if energy.size else (np.empty(0), energy)
    return np.asarray(motions @ V[:, weight > _RESISTS])


def _least_squares(A: Array, B: Array) -> Array:
    """Solve A X = B with the fewest and largest columns of A, whatever the lengths of a joint's arms.

    A column that is almost rounding, of a rotated axis or of two points that coincide, is taken last: a solution of
    least norm in scaled columns would carry the motion with a coordinate that the joint does not move.
    """
    sizes = np.linalg.norm(A, axis=1)
    row = 1 / np.where(sizes > 0, sizes, 1.0)[:, None]
    Q, R, order = la.qr(row * A, mode="economic", pivoting=True)
    own = np.linalg.norm(row * A, axis=0)[order][: R.shape[0]]
    rank = int(np.cumprod(abs(np.diagonal(R)) > np.maximum(_CARRIED * own, DEPENDENT)).sum())
    X = np.zeros((A.shape[1], B.shape[1]))
    X[order[:rank]] = la.solve_triangular(R[:rank, :rank], Q[:, :rank].T @ (row * B))
    return X
