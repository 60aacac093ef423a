"""Everything outboard of a body as one rigid mass on its interfaces: the loading of augmented-body modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.placement import joint_tree
from cmsreduce.errors import SceneError
from cmsreduce.linalg.rigid_fit import best_fit
from cmsreduce.model import (
    FEModel,
    InterfaceLoading,
    Joint,
    OutboardMass,
    Placement,
    RigidBody,
    Scene,
    cross_matrix,
    rigid_body_shapes,
)

__all__ = ["outboard_loading", "outboard_masses"]


def outboard_loading(
    body: FEModel, rows: NDArray[np.int64], bodies: Mapping[str, FEModel | RigidBody], scene: Scene
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
) -> Iterator[tuple[str, NDArray[np.float64], list[str]]]:
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


def _carried(body: FEModel, rows: NDArray[np.int64], face: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Where the dofs of an interface stand in the i-set, and its best-fitting rigid motion (6, dofs)."""
    own = body.interface_rows(face)
    at = np.array([int(np.flatnonzero(rows == row)[0]) for row in own])
    return at, best_fit(body, own, body.interfaces[face].position)


def _spin(
    bodies: Mapping[str, FEModel | RigidBody], placed: Mapping[str, Placement], joint: Joint, frame: Placement
) -> NDArray[np.float64]:
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


def _mass_about(
    body: FEModel | RigidBody, place: Placement, pivot: NDArray[np.float64], frame: Placement
) -> NDArray[np.float64]:
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


def _rigid_rows(body: FEModel, rows: NDArray[np.int64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    if body.nodes is None:
        raise SceneError(
            f"component '{body.name}' has no geometry, so augmented-body modes cannot carry mass along its arms; give "
            "`geometry:`, or use another mode set"
        )
    return np.asarray(rigid_body_shapes(body.dofs, body.nodes, point)[rows])
