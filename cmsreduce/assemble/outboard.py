"""Everything outboard of a body as one rigid mass on its interfaces: the loading of augmented-body modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.placement import joint_tree
from cmsreduce.errors import SceneError
from cmsreduce.model import (
    FEModel,
    InterfaceLoading,
    Joint,
    Placement,
    RigidBody,
    Scene,
    cross_matrix,
    rigid_body_shapes,
)

__all__ = ["outboard_loading"]

# Rigid motions that an interface shows less than this share of, relative to the largest, it cannot carry mass in.
_SHOWN = 1e-8


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
    _, inboard_of = joint_tree(scene)
    placed = {name: scene.placements.get(name, Placement()) for name in bodies}
    names: list[str] = []
    for joint in scene.joints:
        outer = next((name for name, inner in inboard_of.items() if inner is joint), None)
        ends = {joint.first.body: joint.first, joint.second.body: joint.second}
        if outer is None or body.name not in ends or outer == body.name:
            continue
        group = _beyond(outer, inboard_of)
        face = body.interfaces[ends[body.name].name]
        here = placed[body.name]
        pivot = here.rotation @ face.position[0] + here.translation
        mass = sum((_mass_about(bodies[name], placed[name], pivot, here) for name in group), np.zeros((6, 6)))
        held = (link for link in scene.joints if link.first.body in group and link.elements)
        mass = sum((_spin(bodies, placed, link, here) for link in held), mass)
        at, motion = _carried(body, rows, face.name)
        M[np.ix_(at, at)] += motion.T @ mass @ motion
        names += group
    for joint in scene.joints:
        if joint.first.body == body.name and joint.elements:
            at, motion = _carried(body, rows, joint.first.name)
            M[np.ix_(at, at)] += motion.T @ _spin(bodies, placed, joint, placed[body.name]) @ motion
    return InterfaceLoading(np.zeros((i, i)), M, tuple(names))


def _carried(body: FEModel, rows: NDArray[np.int64], face: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Where the dofs of an interface stand in the i-set, and its best-fitting rigid motion (6, dofs)."""
    own = body.interface_rows(face)
    at = np.array([int(np.flatnonzero(rows == row)[0]) for row in own])
    return at, _best_fit(body, own, body.interfaces[face].position)


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


def _best_fit(body: FEModel, rows: NDArray[np.int64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rigid motion of an interface about its first node that fits its dofs best (6, rows)."""
    # Rotations count by what they move at the edge of the interface, so that units do not matter.
    edge = float(np.linalg.norm(position - position[0], axis=1).max()) or 1.0
    row = np.where(np.isin(body.dofs.component[rows], (4, 5, 6)), edge, 1.0)
    column = np.array([1.0, 1.0, 1.0, edge, edge, edge])
    R = _rigid_rows(body, rows, position[0])
    return np.asarray(la.pinv(row[:, None] * R / column, rtol=_SHOWN) * row / column[:, None])


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
