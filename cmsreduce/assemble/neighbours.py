"""What a body feels of those it is joined to, condensed to its own interface."""

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
from cmsreduce.linalg.eigen import null_space
from cmsreduce.model import Configuration, FEModel, InterfaceLoading, Joint, Placement, Point, Scene, Substructure

__all__ = ["AS_BUILT", "grounded_rows", "joined_to", "joint_rows", "neighbour_loading"]

AS_BUILT = Configuration("as built")
"""Reference configuration: every joint at zero."""

# A motion with less than this share of the mass and of the stiffness of the others has none.
_FELT = 1e-14
# Sets of dofs that are the same in any axes.
_WHOLE = {frozenset({1, 2, 3}), frozenset({4, 5, 6}), frozenset(range(1, 7))}
# A motion that a joint locks is carried by the neighbour's coordinates to this share of the row.
_CARRIED = 1e-8


def joined_to(scene: Scene, body: str) -> dict[str, list[Joint]]:
    """Bodies that are joined to one, and by which joints."""
    found: dict[str, list[Joint]] = {}
    for joint in scene.joints:
        ends = [joint.first.body, joint.second.body]
        if body in ends and ends[0] != ends[1]:
            ends.remove(body)
            found.setdefault(ends[0], []).append(joint)
    return found


def grounded_rows(body: FEModel, rows: NDArray[np.int64], scene: Scene) -> NDArray[np.int64]:
    """Positions in the i-set of the dofs that the ground holds."""
    faces = [point.name for point in scene.ground if point.body == body.name]
    held = [row for face in faces for row in body.interface_rows(face)]
    return np.flatnonzero(np.isin(rows, held))


def joint_rows(
    here: Substructure, there: Substructure, joints: Iterable[Joint], ground: Iterable[Point], scene: Scene
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Constraints of joints between two bodies as built, and of the ground, without the joints' springs.

    Parameters
    ----------
    here, there : Substructure
        The two bodies, of m and p coordinates.
    joints : iterable of Joint
        Joints between them.
    ground : iterable of Point
        Interfaces of the two that are held to the ground.
    scene : Scene
        Where the bodies stand.

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
        configurations=(AS_BUILT,),
        actuators=(),
        sensors=(),
        base=here.name,
        ground=tuple(ground),
        floating=(),
    )
    stack = PointStack({here.name: here, there.name: there})
    A = dense(stack.spread(wire(stack, pair, AS_BUILT).A))
    return A[:, : here.m], A[:, here.m :]


def neighbour_loading(here: Substructure, others: Iterable[Substructure], scene: Scene) -> InterfaceLoading:
    """Stiffness and mass of the neighbours on the i-set of a body, joints as built and held (Benfield-Hruda).

    Parameters
    ----------
    here : Substructure
        The i-set of the body: its coordinates are the interface dofs.
    others : iterable of Substructure
        Neighbours, condensed to where they are joined.
    scene : Scene
        Whose joints.

    Raises
    ------
    ConstraintError
        If a neighbour cannot follow the body in a motion the joint locks.

    Notes
    -----
    The neighbour loads every dof of the shared interface, those that the joint leaves free too: its motors act
    there, and no static mode is at hand to answer them. The joint's own inertia is part of the loading, once, and
    rides on its first interface, whichever body has it; its springs strain only where a motion stays free. With
    A_h x + A_t y = 0 the neighbour moves as y = -A_t^+ A_h x + N z, N the null space of A_t: a motion of it that the
    interface does not hold stays a coordinate z of its own. Source: Benfield and Hruda (1971); theory section 2.
    """
    i = here.m
    K, M = np.zeros((i, i)), np.zeros((i, i))
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
                f"'{there.name}' cannot load '{here.name}': a motion that their joint locks is none of the neighbour's "
                "own dofs. Free it in the joint, or use craig-bampton or macneal-rubin"
            )
        free = _felt(there, null_space(A_there)[0])
        z = K.shape[0] - i
        shapes = np.zeros((there.m, K.shape[0] + free.shape[1]))
        shapes[:, :i], shapes[:, i + z :] = follow, free
        K = _grown(K, free.shape[1]) + shapes.T @ (dense(there.K) @ shapes)
        M = _grown(M, free.shape[1]) + shapes.T @ (dense(there.M) @ shapes)
        for stiffness, inertia, row in _elements(here, there, joints_to[there.name], shapes, scene):
            K, M = K + stiffness * np.outer(row, row), M + inertia * np.outer(row, row)
        names.append(there.name)
    return InterfaceLoading(K, M, tuple(names), AS_BUILT.name)


def _elements(
    here: Substructure, there: Substructure, joints: Iterable[Joint], shapes: NDArray[np.float64], scene: Scene
) -> Iterator[tuple[float, float, NDArray[np.float64]]]:
    """Springs and inertias of joints to a neighbour: stiffness, inertia, and the motion they act on (i + z,)."""
    stack = PointStack({here.name: here, there.name: there})
    placed = {name: scene.placements.get(name, Placement()) for name in stack.substructures}
    for joint in joints:
        for element in joint.elements:
            rows = np.array(
                [motion_of(stack, placed, joint, element.dof) for motion_of in (relative_motion, first_motion)]
            )
            across, first = _follow(dense(stack.spread(rows)), here.m, shapes)
            yield element.stiffness, 0.0, across
            yield 0.0, element.inertia, first


def _follow(rows: NDArray[np.float64], i: int, shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows over the i-set and the neighbour's own coordinates, the neighbour following."""
    return np.pad(rows[:, :i], ((0, 0), (0, shapes.shape[1] - i))) + rows[:, i:] @ shapes


def _locked(joint: Joint, here: Substructure, there: Substructure) -> Joint:
    """The joint with its free motions held, where both interfaces have the same dofs whatever their axes."""
    faces = [
        sub.interfaces[end.name] for sub in (here, there) for end in (joint.first, joint.second) if end.body == sub.name
    ]
    dofs = {frozenset(components) for face in faces for components in face.components}
    whole = len(dofs) == 1 and dofs <= _WHOLE
    return joint.locked() if whole else joint


def _felt(there: Substructure, motions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Motions of a neighbour that have mass or stiffness: the spin of a rod about its own axis has neither."""
    energy = np.zeros((motions.shape[1], motions.shape[1]))
    for A in (there.K, there.M):
        whole = motions.T @ (dense(A) @ motions)
        energy += whole / (float(np.trace(whole)) or 1.0)
    weight, V = la.eigh(energy) if energy.size else (np.empty(0), energy)
    return np.asarray(motions @ V[:, weight > _FELT])


def _least_squares(A: NDArray[np.float64], B: NDArray[np.float64]) -> NDArray[np.float64]:
    """Solve A X = B, with rows and columns of A scaled: the arms of a joint are long in some units."""
    row = _unit(np.linalg.norm(A, axis=1))[:, None]
    column = _unit(np.linalg.norm(row * A, axis=0))
    X, *_ = la.lstsq(row * A * column, row * B, cond=_CARRIED)
    return np.asarray(column[:, None] * X)


def _unit(lengths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Factors that make lengths one, where they are not zero."""
    return 1 / np.where(lengths > 0, lengths, 1.0)


def _grown(A: NDArray[np.float64], more: int) -> NDArray[np.float64]:
    return np.pad(A, (0, more))
