"""The mode set of one body, with the loading of its interfaces by neighbours and with shapes of shared interfaces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble import (
    grounded_rows,
    interface_substructure,
    joined_to,
    joint_rows,
    neighbour_loading,
    outboard_loading,
    reduced_substructure,
    rigid_substructure,
)
from cmsreduce.config import ReduceKeys
from cmsreduce.errors import SceneError
from cmsreduce.linalg.blocks import svd
from cmsreduce.model import FEModel, InterfaceLoading, Joint, Point, RigidBody, Scene, Substructure
from cmsreduce.pipeline.bodies.bodies import FlexibleBody
from cmsreduce.reduce import METHODS, BenfieldHruda, CraigBampton, Guyan, InterfaceReduction, Reduction, reduction

__all__ = [
    "body_reduction",
    "loading_by_neighbours",
    "loading_by_outboard",
    "shared_interfaces",
]

# A motion of a shared interface is new when the others leave this share of it: characteristic shapes of two bodies
# are seldom nearer than that without being the same.
_NEW = 1e-6


def body_reduction(
    name: str,
    keys: ReduceKeys,
    cutoff_hz: float,
    bodies: Mapping[str, FlexibleBody],
    rigid_bodies: Mapping[str, RigidBody],
    interface_cutoffs_hz: Mapping[str, float],
    scene: Scene,
) -> Reduction:
    """Prepare the reduction of a body.

    Parameters
    ----------
    name : str
        The body.
    keys : ReduceKeys
        Its mode set.
    cutoff_hz : float
        Highest frequency of normal modes.
    bodies, rigid_bodies : mapping of name to body
        All bodies of the scene: neighbours load an interface, or share its shapes.
    interface_cutoffs_hz : mapping of name to float
        Interface cutoff of bodies whose interfaces of several nodes are reduced.
    scene : Scene
        Its joints.
    """
    kind = METHODS[keys.method]
    shared: InterfaceReduction | None = None
    loading: InterfaceLoading | None = None
    if keys.interface_cutoff_bands is not None and issubclass(kind, CraigBampton):
        shared = shared_interfaces(name, bodies, interface_cutoffs_hz, scene)
    if issubclass(kind, BenfieldHruda):
        if kind.stiffness_loading:
            rigid = {other: rigid_substructure(body) for other, body in rigid_bodies.items()}
            loading = loading_by_neighbours(name, bodies, rigid, scene)
        else:
            loading = loading_by_outboard(name, bodies, rigid_bodies, scene)
    return reduction(keys.method, cutoff_hz, shared, loading, damped=keys.damped, inertia=keys.inertia)


def loading_by_neighbours(
    name: str, bodies: Mapping[str, FlexibleBody], rigid_bodies: Mapping[str, Substructure], scene: Scene
) -> InterfaceLoading:
    """Stiffness and mass that the neighbours of a body add on its i-set, joints as built.

    Parameters
    ----------
    name : str
        The body.
    bodies : mapping of name to FlexibleBody
        Flexible bodies of the scene.
    rigid_bodies : mapping of name to Substructure
        The rigid ones.
    scene : Scene
        Joints and ground.
    """
    here = bodies[name]
    i_set = interface_substructure(here.body, here.ports.interface, here.body.interfaces)
    others = [
        rigid_bodies[other] if other in rigid_bodies else _condensed(bodies[other], joints, scene)
        for other, joints in joined_to(scene, name).items()
    ]
    held = grounded_rows(here.body, here.ports.interface, scene)
    return replace(neighbour_loading(i_set, others, scene), grounded=held)


def loading_by_outboard(
    name: str, bodies: Mapping[str, FlexibleBody], rigid_bodies: Mapping[str, RigidBody], scene: Scene
) -> InterfaceLoading:
    """Mass of everything outboard of a body on its i-set."""
    every: dict[str, FEModel | RigidBody] = {other: flexible.body for other, flexible in bodies.items()}
    here = bodies[name]
    loading = outboard_loading(here.body, here.ports.interface, {**every, **rigid_bodies}, scene)
    return replace(loading, grounded=grounded_rows(here.body, here.ports.interface, scene))


def shared_interfaces(
    name: str, bodies: Mapping[str, FlexibleBody], cutoffs_hz: Mapping[str, float], scene: Scene
) -> InterfaceReduction | None:
    """Reduction of the interfaces of several nodes of a body, alike on both sides of every joint.

    Parameters
    ----------
    name : str
        The body.
    bodies : mapping of name to FlexibleBody
        Flexible bodies of the scene.
    cutoffs_hz : mapping of name to float
        Interface cutoff of every body whose interfaces are reduced.
    scene : Scene
        Joints.

    Returns
    -------
    InterfaceReduction or None
        None where the body has no interface of several nodes.

    Raises
    ------
    SceneError
        If two such interfaces of a body that is joined at one of them share a node.

    Notes
    -----
    Two bodies whose common interface is reduced to different shapes could hardly move together there. Both therefore
    get the shapes of both.
    """
    body, rows = bodies[name].body, _many_rows(bodies[name].body)
    if not rows.size:
        return None
    partners = {
        face: joint
        for joint in scene.joints
        for face in _faces_at(joint, name)
        if all(_takes_part(end, bodies, cutoffs_hz) for end in _ends(joint))
    }
    if not partners:
        return InterfaceReduction(cutoffs_hz[name], np.unique(rows))
    if np.unique(rows).size < rows.size:
        raise SceneError(
            f"component '{name}': two of its interfaces share a node, so they cannot be reduced one by one to the "
            "shapes of their neighbours; take `interface_cutoff` out, or make them one interface"
        )
    own = _characteristic(bodies[name], cutoffs_hz[name])
    blocks, start = [], 0
    for face in (face for face in body.interfaces if _is_many(body, face)):
        size = body.interface_rows(face).size
        block = _independent(own[start : start + size])
        if face in partners:
            block = _of_both(partners[face], name, bodies, cutoffs_hz, scene)
        blocks.append(block)
        start += size
    return InterfaceReduction(cutoffs_hz[name], rows, la.block_diag(*blocks))


def _condensed(flexible: FlexibleBody, joints: list[Joint], scene: Scene) -> Substructure:
    """A neighbour condensed to the dofs by which it is joined, with the rigid motions that these leave free."""
    body, rigid = flexible.body, flexible.rigid
    faces = [face for joint in joints for face in _faces_at(joint, body.name)]
    faces += [point.name for point in scene.ground if point.body == body.name]
    rows = np.unique(np.concatenate([body.interface_rows(face) for face in faces]))
    still = la.null_space(rigid[rows], rcond=1e-9) if rigid.shape[1] else np.empty((0, 0))
    if still.size:
        # Dofs that hold these motions are added to the i-set: the body follows them without strain.
        _, _, order = la.qr((rigid @ still).T, mode="economic", pivoting=True)
        rows = np.union1d(rows, order[: still.shape[1]])
    return reduced_substructure(Guyan(0.0).reduce(body, rows, rigid=rigid), faces)


def _of_both(
    joint: Joint, name: str, bodies: Mapping[str, FlexibleBody], cutoffs_hz: Mapping[str, float], scene: Scene
) -> NDArray[np.float64]:
    """Motions of a shared interface in the shapes of either body, in the dofs of one of them."""
    ends = _ends(joint)
    rows = [bodies[end.body].body.interface_rows(end.name) for end in ends]
    subs = [interface_substructure(bodies[end.body].body, at, [end.name]) for end, at in zip(ends, rows, strict=True)]
    A_first, A_second = joint_rows(subs[0], subs[1], [joint], [], scene)
    shapes = []
    for end, at in zip(ends, rows, strict=True):
        body = bodies[end.body].body
        many = np.isin(_many_rows(body), at)
        shapes.append(_characteristic(bodies[end.body], cutoffs_hz[end.body])[many])
    # One choice for both sides, in the dofs of the first.
    first = _independent(np.hstack([shapes[0], la.lstsq(A_first, -A_second @ shapes[1])[0]]))
    return first if ends[0].body == name else np.asarray(la.lstsq(A_second, -A_first @ first)[0])


def _characteristic(flexible: FlexibleBody, cutoff_hz: float) -> NDArray[np.float64]:
    """Motions of the interfaces of several nodes in the body's own reduction of them."""
    own = CraigBampton(0.0, interface_reduction=InterfaceReduction(cutoff_hz, _many_rows(flexible.body)))
    return own.characteristic_shapes(flexible.body, flexible.ports.interface, flexible.rigid)


def _independent(shapes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Orthonormal columns with the same span."""
    lengths = np.linalg.norm(shapes, axis=0)
    u, s, _ = svd(shapes[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    return np.asarray(u[:, s > _NEW * s.max(initial=0.0)])


def _many_rows(body: FEModel) -> NDArray[np.int64]:
    rows = [body.interface_rows(face) for face in body.interfaces if _is_many(body, face)]
    return np.concatenate(rows) if rows else np.empty(0, dtype=np.int64)


def _is_many(body: FEModel, face: str) -> bool:
    return body.interfaces[face].node.size > 1


def _ends(joint: Joint) -> tuple[Point, Point]:
    return joint.first, joint.second


def _faces_at(joint: Joint, body: str) -> list[str]:
    return [point.name for point in _ends(joint) if point.body == body]


def _takes_part(end: Point, bodies: Mapping[str, FlexibleBody], cutoffs_hz: Mapping[str, float]) -> bool:
    return end.body in cutoffs_hz and _is_many(bodies[end.body].body, end.name)
