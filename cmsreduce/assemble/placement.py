"""Placement of the bodies when the joints are turned, and the geometry of a joint."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model import (
    FIRST_ROTATION,
    SCALAR,
    Configuration,
    Interface,
    Joint,
    Placement,
    Point,
    Scene,
    cross_matrix,
)

__all__ = [
    "Joined",
    "bodies_beyond",
    "carried_axes",
    "interface_at",
    "joint_arms",
    "joint_axes",
    "joint_gap",
    "joint_tree",
    "motion_axes",
    "place_bodies",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Cosine between the two axes of a universal joint: a larger one comes from a setting of the rotation that it locks.
_HELD_TURNED = 1e-3


class Joined(Protocol):
    """Anything with interfaces: a body of an assembly, or of a scene read back from its files."""

    @property
    def interfaces(self) -> Mapping[str, Interface]:
        """Interfaces by name, in the body's basic frame."""
        ...


def place_bodies(
    substructures: Mapping[str, Joined], scene: Scene, configuration: Configuration
) -> dict[str, Placement]:
    """Turn everything outboard of each articulated joint.

    Joints are taken in order from the base body outwards. An angle turns the outboard side about the joint's axis,
    right handed, relative to the inboard side; several freedoms of one joint are turned in the order x y z rx ry rz
    about the axes of the first interface before the turn. The pivot is the second interface: an offset, or a slide, is
    fixed to the first body.

    Parameters
    ----------
    substructures : mapping of name to Joined
        Bodies with the positions of their interfaces; bodies of joints have no position.
    scene : Scene
        Joints, base, placements as built.
    configuration : Configuration
        Angles in radians, displacements in the scene's unit of length.

    Returns
    -------
    dict of name to Placement

    Raises
    ------
    SceneError
        If a body is not joined to another, and the scene does not name it as floating.
    """
    placed = {name: scene.placements.get(name, Placement()) for name in substructures}
    reached, inboard_of = joint_tree(scene)
    lost = [name for name in substructures if name in scene.bodies and name not in reached]
    if lost:
        raise SceneError(
            f"component '{lost[0]}' is joined to nothing: no chain of joints leads from it to '{reached[0]}'. Add a "
            "joint, ground it, let it float (`scene.floating`), or take it out of the pipeline"
        )
    for outer in reached:
        if outer not in inboard_of:
            continue
        joint = inboard_of[outer]
        for dof in range(6):
            value = configuration.angles.get((joint.name, dof), 0.0)
            if value:
                pivot, axes = _position(substructures, placed, joint.second), joint_axes(substructures, placed, joint)
                for name in bodies_beyond(outer, inboard_of):
                    placed[name] = _moved(placed[name], pivot, axes[dof % 3], value, turn=dof >= 3)
    return placed


def joint_tree(scene: Scene) -> tuple[list[str], dict[str, Joint]]:
    """Order the bodies along the joints, outwards from the base body, the ground, and floating bodies.

    Returns
    -------
    reached : list of str
        Bodies in this order, the base first.
    inboard_of : dict of name to Joint
        Inboard joint of each body; the base, grounded and floating bodies have none.
    """
    base = scene.base or scene.bodies[0]
    reached, inboard_of = [base], dict[str, Joint]()
    roots = {base, *scene.floating} | {point.body for point in scene.ground}
    reached += [name for name in scene.bodies if name in roots - {base}]
    at = 0
    while at < len(reached):
        for joint in scene.joints:
            ends = (joint.first.body, joint.second.body)
            if reached[at] in ends:
                outer = ends[1] if ends[0] == reached[at] else ends[0]
                if outer not in reached:
                    reached.append(outer)
                    inboard_of[outer] = joint
        at += 1
    return reached, inboard_of


def bodies_beyond(outer: str, inboard_of: Mapping[str, Joint]) -> list[str]:
    """List a body and all bodies that it carries, away from the base; ``inboard_of`` as from `joint_tree`."""
    found = [outer]
    for name, joint in inboard_of.items():
        inner = joint.first.body if joint.second.body == name else joint.second.body
        if inner == outer:
            found += bodies_beyond(name, inboard_of)
    return found


def joint_axes(substructures: Mapping[str, Joined], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Axes of a joint as rows, in scene components: those of its first interface (3, 3)."""
    face = interface_at(substructures, joint.first)
    return np.asarray(face.frame @ placed[joint.first.body].rotation.T)


def carried_axes(
    substructures: Mapping[str, Joined], scene: Scene, placed: Mapping[str, Placement], joint: Joint
) -> Array:
    """Axes of a joint as built, carried by its second body since then: rows, in scene components (3, 3)."""
    ends = (joint.first.body, joint.second.body)
    built = [scene.placements.get(body, Placement()).rotation for body in ends]
    as_built = interface_at(substructures, joint.first).frame @ built[0].T
    return np.asarray(as_built @ built[1] @ placed[joint.second.body].rotation.T)


def motion_axes(
    substructures: Mapping[str, Joined], scene: Scene, placed: Mapping[str, Placement], joint: Joint, dof: int
) -> Array:
    """Axes of the translations or rotations of a joint, whichever ``dof`` is, in scene components: rows (3, 3).

    Of two free rotations the earlier comes first: it turns about an axis of the second side, the later about one of the
    first side, as in a universal joint. The rotation about the normal to both is locked. These are the axes of the
    first side only while the later rotation is zero.
    """
    axes = joint_axes(substructures, placed, joint)
    free = sorted(each - FIRST_ROTATION for each in joint.free if each >= FIRST_ROTATION)
    if dof < FIRST_ROTATION or len(free) != 2:
        return axes
    (earlier, later), carried = free, carried_axes(substructures, scene, placed, joint)
    if abs(axes[later] @ carried[earlier]) > _HELD_TURNED:
        return axes
    turning = axes.copy()
    turning[earlier] = carried[earlier]
    normal = np.cross(carried[earlier], axes[later]) * (1 if (later - earlier) % 3 == 1 else -1)
    turning[3 - earlier - later] = normal / np.linalg.norm(normal)
    return turning


def joint_gap(substructures: Mapping[str, Joined], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Vector from the first interface's nodes (offset included) to the second's, in the scene (p, 3)."""
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    a, b = placed[joint.first.body], placed[joint.second.body]
    arm = np.asarray(joint.offset if joint.offset is not None else (0.0, 0.0, 0.0))
    here = (first.position + arm) @ a.rotation.T + a.translation
    there = second.position @ b.rotation.T + b.translation
    return np.asarray(there - here)


def joint_arms(substructures: Mapping[str, Joined], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Rigid arms from the first interface's nodes to the second's, in the first body's basic axes (p, 3).

    They include the joint's offset and slide, and carry motion of the first interface to the second.
    """
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    if any(components == (SCALAR,) for face in (first, second) for components in face.components):
        return np.zeros((first.node.size, 3))
    arm = np.asarray(joint.offset if joint.offset is not None else (0.0, 0.0, 0.0))
    return np.asarray(joint_gap(substructures, placed, joint) @ placed[joint.first.body].rotation + arm)


def interface_at(substructures: Mapping[str, Joined], point: Point) -> Interface:
    """Interface named by a point.

    Raises
    ------
    SceneError
        If the body has no such interface.
    """
    faces = substructures[point.body].interfaces
    if point.name not in faces:
        raise SceneError(
            f"'{point}': component '{point.body}' has no interface '{point.name}' "
            f"(it has: {', '.join(faces) or 'none'})"
        )
    return faces[point.name]


def _position(substructures: Mapping[str, Joined], placed: Mapping[str, Placement], point: Point) -> Array:
    place = placed[point.body]
    return np.asarray(place.rotation @ interface_at(substructures, point).position[0] + place.translation)


def _moved(place: Placement, pivot: Array, axis: Array, value: float, *, turn: bool) -> Placement:
    if not turn:
        return Placement(place.rotation, place.translation + value * axis)
    skew = cross_matrix(axis)
    Q = np.eye(3) + np.sin(value) * skew + (1 - np.cos(value)) * skew @ skew
    return Placement(Q @ place.rotation, Q @ (place.translation - pivot) + pivot)
