"""Where every body stands when the joints are turned.

Everything outboard of a body as one rigid mass on its interfaces: the loading of augmented-body modes.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.mechanics import best_fit
from cmsreduce.model import (
    SCALAR,
    Configuration,
    FEModel,
    Interface,
    InterfaceLoading,
    Joint,
    OutboardMass,
    Placement,
    Point,
    RigidBody,
    Scene,
    Substructure,
    cross_matrix,
    rigid_body_shapes,
)

__all__ = [
    "interface_at",
    "joint_arms",
    "joint_axes",
    "joint_gap",
    "joint_tree",
    "outboard_loading",
    "outboard_masses",
    "place_bodies",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


def place_bodies(
    substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration
) -> dict[str, Placement]:
    """Turn everything outboard of each articulated joint.

    Joints are walked outwards from the base body. An angle turns the outboard side about the joint's axis, right
    handed, relative to the inboard side; several freedoms of one joint are turned in the order x y z rx ry rz
    about the axes of the first interface as they stand before. The pivot is the second interface: an offset, or
    a slide, is fixed to the first body.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies with the positions of their interfaces; those that joints own stand nowhere.
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
        If a body is joined to nothing, and the scene does not name it as floating.
    """
    placed = {name: scene.placements.get(name, Placement()) for name in substructures}
    reached, inboard_of = joint_tree(scene)
    lost = [name for name in substructures if name in scene.bodies and name not in reached]
    if lost:
        raise SceneError(
            f"component '{lost[0]}' is joined to nothing: no chain of joints leads from it to '{reached[0]}'. Add a "
            "joint, ground it, let it float (`scene.floating`), or take it out of the pipeline"
        )
    children: dict[str, list[str]] = {name: [] for name in reached}
    for outer, joint in inboard_of.items():
        children[joint.first.body if joint.second.body == outer else joint.second.body].append(outer)
    for outer in reached:
        if outer not in inboard_of:
            continue
        joint = inboard_of[outer]
        for dof in range(6):
            value = configuration.angles.get((joint.name, dof), 0.0)
            if value:
                pivot, axes = _position(substructures, placed, joint.second), joint_axes(substructures, placed, joint)
                for name in _outboard(outer, children):
                    placed[name] = _moved(placed[name], pivot, axes[dof % 3], value, turn=dof >= 3)
    return placed


def joint_tree(scene: Scene) -> tuple[list[str], dict[str, Joint]]:
    """Walk the joints outwards from the base body, the ground, and bodies that float by themselves.

    Returns
    -------
    reached : list of str
        Bodies in the order they are come to, the base first.
    inboard_of : dict of name to Joint
        The joint that each body hangs on; the base, grounded and floating bodies hang on none.
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


def joint_axes(substructures: Mapping[str, Substructure], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Axes of a joint as rows, in scene components: those of its first interface (3, 3)."""
    face = interface_at(substructures, joint.first)
    return np.asarray(face.frame @ placed[joint.first.body].rotation.T)


def joint_gap(substructures: Mapping[str, Substructure], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Vector from the first interface's nodes (offset included) to the second's, in the scene (p, 3)."""
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    a, b = placed[joint.first.body], placed[joint.second.body]
    arm = np.asarray(joint.offset if joint.offset is not None else (0.0, 0.0, 0.0))
    here = (first.position + arm) @ a.rotation.T + a.translation
    there = second.position @ b.rotation.T + b.translation
    return np.asarray(there - here)


def joint_arms(substructures: Mapping[str, Substructure], placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Rigid arms from the first interface's nodes to the second's, in the first body's basic axes (p, 3).

    They hold the joint's offset and how far it is slid; what motion of the first interface does at the second is
    measured with them.
    """
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    if any(components == (SCALAR,) for face in (first, second) for components in face.components):
        return np.zeros((first.node.size, 3))
    arm = np.asarray(joint.offset if joint.offset is not None else (0.0, 0.0, 0.0))
    return np.asarray(joint_gap(substructures, placed, joint) @ placed[joint.first.body].rotation + arm)


def interface_at(substructures: Mapping[str, Substructure], point: Point) -> Interface:
    """Interface a joint names.

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


def _position(substructures: Mapping[str, Substructure], placed: Mapping[str, Placement], point: Point) -> Array:
    place = placed[point.body]
    return np.asarray(place.rotation @ interface_at(substructures, point).position[0] + place.translation)


def _outboard(name: str, children: Mapping[str, list[str]]) -> list[str]:
    found = [name]
    for child in children[name]:
        found += _outboard(child, children)
    return found


def _moved(place: Placement, pivot: Array, axis: Array, value: float, *, turn: bool) -> Placement:
    if not turn:
        return Placement(place.rotation, place.translation + value * axis)
    skew = cross_matrix(axis)
    Q = np.eye(3) + np.sin(value) * skew + (1 - np.cos(value)) * skew @ skew
    return Placement(Q @ place.rotation, Q @ (place.translation - pivot) + pivot)


def outboard_loading(
    body: FEModel, rows: Indices, bodies: Mapping[str, FEModel | RigidBody], scene: Scene
) -> InterfaceLoading:
    """Mass and inertia of everything outboard of a body, rigid, on its interfaces (augmented-body modes).

    Parameters
    ----------
    body : FEModel
        The body, with nodes.
    rows : (i,) int64
        Its i-set.
    bodies : mapping of name to FEModel or RigidBody
        All bodies of the scene.
    scene : Scene
        Joints, placements; the base body decides what is outboard.

    Raises
    ------
    SceneError
        If a body has no geometry, so that its mass cannot be carried along an arm.

    Notes
    -----
    An interface of several nodes takes the mass through the rigid motion that fits its dofs best; a point without
    rotations takes it as a point mass. A joint's own inertia rides on its first interface: it is counted with the
    body that has it, once, be that this one or an outboard one.
    """
    i = rows.size
    M = np.zeros((i, i))
    found = list(_joined(body, bodies, scene))
    for face, mass, _ in found:
        at, motion = _carried(body, rows, face)
        M[np.ix_(at, at)] += motion.T @ mass @ motion
    return InterfaceLoading(np.zeros((i, i)), M, tuple(name for _, _, names in found for name in names))


def outboard_masses(body: FEModel, bodies: Mapping[str, FEModel | RigidBody], scene: Scene) -> tuple[OutboardMass, ...]:
    """Rigid mass of everything outboard of each interface of a body, as the scene is built.

    Parameters
    ----------
    body : FEModel
        The body.
    bodies : mapping of name to FEModel or RigidBody
        All bodies of the scene.
    scene : Scene
        Joints, placements; the base body decides what is outboard.

    Returns
    -------
    tuple of OutboardMass
        Of each interface that carries something, in the order of the body's interfaces.

    Raises
    ------
    SceneError
        If a body has no geometry, so that its mass cannot be carried along an arm.
    """
    found = list(_joined(body, bodies, scene))
    carried = []
    for face, interface in body.interfaces.items():
        parts = [(mass, names) for name, mass, names in found if name == face]
        if parts:
            mass = sum((mass for mass, _ in parts), np.zeros((6, 6)))
            names = tuple(name for _, names in parts for name in names)
            carried.append(OutboardMass(face, interface.position[0], mass, names))
    return tuple(carried)


def _joined(
    body: FEModel, bodies: Mapping[str, FEModel | RigidBody], scene: Scene
) -> Iterator[tuple[str, Array, list[str]]]:
    """Interface, mass matrix about its first node along the body's axes (6, 6), and bodies, of each joint outwards."""
    _, inboard_of = joint_tree(scene)
    placed = {name: scene.placements.get(name, Placement()) for name in bodies}
    here = placed[body.name]
    for joint in scene.joints:
        outer = next((name for name, inner in inboard_of.items() if inner is joint), None)
        ends = {joint.first.body: joint.first, joint.second.body: joint.second}
        if outer is None or body.name not in ends or outer == body.name:
            continue
        group = _beyond(outer, inboard_of)
        face = body.interfaces[ends[body.name].name]
        pivot = here.rotation @ face.position[0] + here.translation
        mass = sum((_mass_about(bodies[name], placed[name], pivot, here) for name in group), np.zeros((6, 6)))
        held = (link for link in scene.joints if link.first.body in group and link.elements)
        yield face.name, sum((_spin(bodies, placed, link, here) for link in held), mass), group
    for joint in scene.joints:
        if joint.first.body == body.name and joint.elements:
            yield joint.first.name, _spin(bodies, placed, joint, here), []


def _carried(body: FEModel, rows: Indices, face: str) -> tuple[Indices, Array]:
    """Where the dofs of an interface stand in the i-set, and its best-fitting rigid motion (6, dofs)."""
    own = body.interface_rows(face)
    at = np.array([int(np.flatnonzero(rows == row)[0]) for row in own])
    return at, best_fit(body, own, body.interfaces[face].position)


def _spin(
    bodies: Mapping[str, FEModel | RigidBody], placed: Mapping[str, Placement], joint: Joint, frame: Placement
) -> Array:
    """Inertia that a joint owns, along the axes of a body (6, 6)."""
    first = joint.first
    axes = bodies[first.body].interfaces[first.name].frame @ placed[first.body].rotation.T @ frame.rotation
    J = np.zeros((6, 6))
    for element in joint.elements:
        if element.inertia:
            J[3:, 3:] += element.inertia * np.outer(axes[element.dof - 3], axes[element.dof - 3])
    return J


def _beyond(outer: str, inboard_of: Mapping[str, Joint]) -> list[str]:
    """A body and everything that hangs on it, away from the base."""
    found = [outer]
    for name, joint in inboard_of.items():
        inner = joint.first.body if joint.second.body == name else joint.second.body
        if inner == outer:
            found += _beyond(name, inboard_of)
    return found


def _mass_about(body: FEModel | RigidBody, place: Placement, pivot: Array, frame: Placement) -> Array:
    """Rigid mass matrix of a body about a point of the scene, along the axes of another body (6, 6)."""
    point = place.rotation.T @ (pivot - place.translation)
    if isinstance(body, RigidBody):
        R = np.eye(6)
        R[:3, 3:] = -cross_matrix(body.cg - point)
        own = R.T @ la.block_diag(body.mass * np.eye(3), body.inertia) @ R
    else:
        R = _rigid_rows(body, np.arange(body.n), point)
        own = R.T @ (body.M @ R)
    turn = la.block_diag(*[frame.rotation.T @ place.rotation] * 2)
    return np.asarray(turn @ own @ turn.T)


def _rigid_rows(body: FEModel, rows: Indices, point: Array) -> Array:
    if body.nodes is None:
        raise SceneError(
            f"component '{body.name}' has no geometry, so augmented-body modes cannot carry mass along its arms; give "
            "`geometry:`, or use another mode set"
        )
    return np.asarray(rigid_body_shapes(body.dofs, body.nodes, point)[rows])
