"""Rigid mass of all bodies outboard of a body, on its interfaces: augmented-body modes and carried masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.placement import bodies_beyond, joint_tree
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import best_fit
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

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


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
    The mass acts on an interface of several nodes through the rigid motion that fits its dofs best, and on a point
    without rotations as a point mass. A joint's own inertia moves with its first interface: it counts once, with the
    body of this interface, which may be this one or an outboard one.
    """
    i = rows.size
    M = np.zeros((i, i))
    found = list(_outboard(body, bodies, scene))
    for face, mass, _ in found:
        own = body.interface_rows(face)
        at = np.array([int(np.flatnonzero(rows == row)[0]) for row in own])
        motion = best_fit(body, own, body.interfaces[face].position)
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
        One for each interface that carries a body, in the order of the body's interfaces.

    Raises
    ------
    SceneError
        If a body has no geometry, so that its mass cannot be carried along an arm.
    """
    found = list(_outboard(body, bodies, scene))
    carried = []
    for face, interface in body.interfaces.items():
        parts = [(mass, names) for name, mass, names in found if name == face]
        if parts:
            mass = sum((mass for mass, _ in parts), np.zeros((6, 6)))
            names = tuple(name for _, names in parts for name in names)
            carried.append(OutboardMass(face, interface.position[0], mass, names))
    return tuple(carried)


def _outboard(
    body: FEModel, bodies: Mapping[str, FEModel | RigidBody], scene: Scene
) -> Iterator[tuple[str, Array, list[str]]]:
    """Interface, mass matrix about its first node along the body's axes (6, 6), and bodies beyond each outer joint."""
    _, inboard_of = joint_tree(scene)
    placed = {name: scene.placements.get(name, Placement()) for name in bodies}
    here = placed[body.name]
    for joint in scene.joints:
        outer = next((name for name, inner in inboard_of.items() if inner is joint), None)
        ends = {joint.first.body: joint.first, joint.second.body: joint.second}
        if outer is None or body.name not in ends or outer == body.name:
            continue
        group = bodies_beyond(outer, inboard_of)
        face = body.interfaces[ends[body.name].name]
        pivot = here.rotation @ face.position[0] + here.translation
        mass = sum((_mass_about(bodies[name], placed[name], pivot, here) for name in group), np.zeros((6, 6)))
        held = (link for link in scene.joints if link.first.body in group and link.elements)
        yield face.name, sum((_spin(bodies, placed, link, here) for link in held), mass), group
    for joint in scene.joints:
        if joint.first.body == body.name and joint.elements:
            yield joint.first.name, _spin(bodies, placed, joint, here), []


def _spin(
    bodies: Mapping[str, FEModel | RigidBody], placed: Mapping[str, Placement], joint: Joint, frame: Placement
) -> Array:
    """Inertia of a joint itself, along the axes of a body (6, 6)."""
    first = joint.first
    axes = bodies[first.body].interfaces[first.name].frame @ placed[first.body].rotation.T @ frame.rotation
    J = np.zeros((6, 6))
    for element in joint.elements:
        if element.inertia:
            J[3:, 3:] += element.inertia * np.outer(axes[element.dof - 3], axes[element.dof - 3])
    return J


def _mass_about(body: FEModel | RigidBody, place: Placement, pivot: Array, frame: Placement) -> Array:
    """Rigid mass matrix of a body about a point of the scene, along the axes of another body (6, 6)."""
    point = place.rotation.T @ (pivot - place.translation)
    if isinstance(body, RigidBody):
        R = np.eye(6)
        R[:3, 3:] = -cross_matrix(body.cg - point)
        own = R.T @ la.block_diag(body.mass * np.eye(3), body.inertia) @ R
    else:
        if body.nodes is None:
            raise SceneError(
                f"component '{body.name}' has no geometry, so augmented-body modes cannot carry mass along its arms; "
                "give `geometry:`, or use another mode set"
            )
        R = rigid_body_shapes(body.dofs, body.nodes, point)
        own = R.T @ (body.M @ R)
    turn = la.block_diag(*[frame.rotation.T @ place.rotation] * 2)
    return np.asarray(turn @ own @ turn.T)
