"""Joints and ground as constraint rows on the motions of points, and relative motion in a joint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.placement import interface_at, joint_arms, joint_axes, joint_gap, motion_axes
from cmsreduce.assemble.points import PointStack
from cmsreduce.errors import SceneError, UnitsError
from cmsreduce.model import (
    DOF_NAMES,
    FIRST_ROTATION,
    Interface,
    Joint,
    Placement,
    Point,
    Scene,
    Substructure,
    cross_matrix,
)

__all__ = [
    "COINCIDENT",
    "Constraints",
    "available",
    "constrain",
    "digits",
    "first_motion",
    "ground_rows",
    "in_body",
    "joint_direction",
    "reach",
    "relative_motion",
]

Array = NDArray[np.float64]

# Direction cosines below this are zero: frames are known to eight digits.
_ALIGNED = 1e-6
COINCIDENT = 1e-5
"""Interfaces of one joint coincide to this share of the size of the system: decks print eight digits or fewer."""
# Longest list of nodes in a message.
_COPIED = 200
_UNIT_RATIOS = {1000.0: "m and mm", 100.0: "m and cm", 39.3700787: "m and in", 25.4: "mm and in", 3.2808399: "m and ft"}


def relative_motion(stack: PointStack, scene: Scene, placed: Mapping[str, Placement], joint: Joint, dof: int) -> Array:
    """Row over the stacked motions: motion of the second interface relative to the first, along a joint axis.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    scene : Scene
        Bodies as built.
    placed : mapping of body to Placement
        Positions of the bodies.
    joint : Joint
        With one node on each side; of several, the first counts.
    dof : int
        0..5 along the joint's axes.

    Returns
    -------
    (size,) float64
    """
    arm = joint_arms(stack.substructures, placed, joint)[0]
    axes = motion_axes(stack.substructures, scene, placed, joint, dof)
    return _relative_row(stack, placed, joint, axes, dof, arm, stack.label(joint.first), stack.label(joint.second))


def _relative_row(
    stack: PointStack,
    placed: Mapping[str, Placement],
    joint: Joint,
    axes: Array,
    dof: int,
    arm: Array,
    near: str,
    far: str,
) -> Array:
    """Row of `relative_motion` for one node of each interface, by their labels and the rigid arm between them."""
    # Motion of the first interface is carried along the arm to the second.
    carry = np.eye(6)
    carry[:3, 3:] = -cross_matrix(arm)
    direction, row = joint_direction(axes, dof), np.zeros(stack.size)
    row[stack.columns(joint.second.body, far)] += in_body(direction, placed[joint.second.body])
    row[stack.columns(joint.first.body, near)] -= in_body(direction, placed[joint.first.body]) @ carry
    return row


def first_motion(stack: PointStack, placed: Mapping[str, Placement], joint: Joint, dof: int) -> Array:
    """Row over the stacked motions: motion of the first interface along a joint axis that it carries (size,)."""
    direction = joint_direction(joint_axes(stack.substructures, placed, joint), dof)
    row = np.zeros(stack.size)
    row[stack.columns(joint.first.body, stack.label(joint.first))] = in_body(direction, placed[joint.first.body])
    return row


def joint_direction(axes: Array, dof: int) -> Array:
    """Weights of x y z rx ry rz (6,) that make a unit motion along one of the axes, which are rows."""
    direction = np.zeros(6)
    direction[dof // 3 * 3 : dof // 3 * 3 + 3] = axes[dof % 3]
    return direction


def in_body(direction: Array, place: Placement) -> Array:
    """Turn weights of six motions (6,) from the axes of the scene to those of a body."""
    return np.concatenate([direction[:3] @ place.rotation, direction[3:] @ place.rotation])


def available(face: Interface, k: int, axes: Array) -> list[bool]:
    """Tell for each motion along ``axes`` (rows, in the body's basic frame) if a node of the interface has it."""
    frame = face.node_frame(k)
    components = {max(c, 1) for c in face.components[k]}
    answer = []
    for dof in range(6):
        missing = [frame[c % 3] for c in range(dof // 3 * 3, dof // 3 * 3 + 3) if c + 1 not in components]
        answer.append(all(abs(axes[dof % 3] @ axis) < _ALIGNED for axis in missing))
    return answer


def digits(face: Interface, k: int) -> str:
    """Dofs of a node of an interface in digits, as in a deck."""
    return "".join(str(c) for c in face.components[k])


@dataclass(frozen=True, eq=False)
class Constraints:
    """Rows A with A (stacked motions) = 0, and the joint of each row.

    Parameters
    ----------
    A : (c, size) float64
        Rows over a `PointStack`.
    owner : tuple of str
        Joint or ground, and the locked motion, of each row.
    gap : float
        Largest distance between joined nodes, relative to the size of the system.
    """

    A: Array
    owner: tuple[str, ...]
    gap: float


def constrain(stack: PointStack, scene: Scene, placed: Mapping[str, Placement], *, as_built: bool) -> Constraints:
    """Constraint rows of every joint and of the ground.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    scene : Scene
        Joints and ground.
    placed : mapping of body to Placement
        Positions of the bodies.
    as_built : bool
        No joint is turned, so that interfaces must coincide in every direction.

    Returns
    -------
    Constraints

    Raises
    ------
    SceneError
        If two interfaces have different dofs or do not coincide.
    UnitsError
        If they would coincide in another unit of length.
    """
    named: list[tuple[Array, str]] = []
    gap = 0.0
    for joint in scene.joints:
        axes = joint_axes(stack.substructures, placed, joint)
        gap = max(gap, _coincidence(stack.substructures, placed, joint, axes, as_built))
        turning = motion_axes(stack.substructures, scene, placed, joint, FIRST_ROTATION)
        named += _joint_rows(stack, placed, joint, axes, turning)
    for point in scene.ground:
        named += ground_rows(stack, point)
    A = np.array([row for row, _ in named]) if named else np.zeros((0, stack.size))
    return Constraints(A, tuple(name for _, name in named), gap)


def _joint_rows(
    stack: PointStack, placed: Mapping[str, Placement], joint: Joint, axes: Array, turning: Array
) -> list[tuple[Array, str]]:
    first, second = (interface_at(stack.substructures, point) for point in (joint.first, joint.second))
    if first.node.size != second.node.size:
        raise SceneError(
            f"joint '{joint.name}' connects {first.node.size} nodes of '{joint.first}' with {second.node.size} of "
            f"'{joint.second}': interfaces are joined node by node. Name as many nodes on both sides, or tie those of "
            "each side to one point (`tie: rigid` or `tie: average` of the interface)"
        )
    if first.node.size > 1 and joint.free:
        raise SceneError(
            f"joint '{joint.name}' has free motions but its interfaces have {first.node.size} nodes each: a hinge "
            "needs one node on either side"
        )
    a, b = placed[joint.first.body], placed[joint.second.body]
    arms, size = joint_arms(stack.substructures, placed, joint), reach(stack.substructures)
    labels = [stack.substructures[p.body].point_labels(f) for p, f in ((joint.first, first), (joint.second, second))]
    locked = [dof for dof in range(6) if dof not in joint.free]
    found = []
    for k, (near, far) in enumerate(zip(*labels, strict=True)):
        here, there = (
            [*available(face, k, axes @ body.rotation)[:3], *available(face, k, turning @ body.rotation)[3:]]
            for face, body in ((first, a), (second, b))
        )
        differ = [DOF_NAMES[dof] for dof in locked if here[dof] != there[dof]]
        if differ and digits(first, k) == digits(second, k):
            along = _xyz((axes if (dof := DOF_NAMES.index(differ[0])) < 3 else turning)[dof % 3])
            at = " and ".join(f"node {face.node[k]}" if face.node[k] >= 0 else "a position" for face in (first, second))
            raise SceneError(
                f"joint '{joint.name}' locks {differ[0]} along {along}, but only one of '{joint.first}' and "
                f"'{joint.second}' can move so: {at} have dofs {digits(first, k)} both, but of axes that are turned. "
                "Give both all axes in which they turn, such as 126 in a plane"
            )
        if differ:
            raise SceneError(
                f"joint '{joint.name}' locks {', '.join(differ)}, but only one of '{joint.first}' (dofs "
                f"{digits(first, k)}) and '{joint.second}' (dofs {digits(second, k)}) can move so: interfaces of a "
                "joint need the same dofs. Give both the same `dofs:`, or free these motions"
            )
        for dof in locked:
            if not here[dof]:
                continue
            if dof < 3:
                _check_carried(first, k, np.cross(arms[k], axes[dof] @ a.rotation), joint, size)
            row = _relative_row(stack, placed, joint, axes if dof < 3 else turning, dof, arms[k], near, far)
            where = f" node {first.node[k]}" if first.node.size > 1 else ""
            found.append((row, f"{joint.name}{where} {DOF_NAMES[dof]}"))
    if locked and not found:
        raise SceneError(
            f"joint '{joint.name}' locks nothing: neither '{joint.first}' (dofs {digits(first, 0)}) nor "
            f"'{joint.second}' (dofs {digits(second, 0)}) can move along its axes "
            f"{', '.join(DOF_NAMES[dof] for dof in locked)}. Check `free:` and the `frame:` of the first interface"
        )
    return found


def _check_carried(face: Interface, k: int, turn: Array, joint: Joint, size: float) -> None:
    """Refuse an arm on a node without the rotation about ``turn`` that would swing the arm."""
    missing = [face.node_frame(k)[c - 4] for c in (4, 5, 6) if c not in face.components[k]]
    if any(abs(turn @ axis) > COINCIDENT * size for axis in missing):
        raise SceneError(
            f"joint '{joint.name}': its interfaces lie apart, by an offset or a slide, but '{joint.first}' (dofs "
            f"{digits(face, k)}) has no rotations to swing the arm between them. Give it a node with all six dofs"
        )


def ground_rows(stack: PointStack, point: Point) -> list[tuple[Array, str]]:
    """Constraint rows that hold one interface to the ground, each with the motion that it locks.

    They lie along the displacement axes of the interface's nodes, so that they do not depend on the configuration.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    point : Point
        An interface, of which every dof is held.
    """
    face = interface_at(stack.substructures, point)
    sub = stack.substructures[point.body]
    found = []
    for k, label in enumerate(sub.point_labels(face)):
        for component in face.components[k]:
            dof = max(component - 1, 0)
            row = np.zeros(stack.size)
            row[stack.columns(point.body, label)] = joint_direction(sub.axes[label], dof)
            found.append((row, f"ground {point} {DOF_NAMES[dof]}"))
    return found


def _coincidence(
    substructures: Mapping[str, Substructure],
    placed: Mapping[str, Placement],
    joint: Joint,
    axes: Array,
    as_built: bool,
) -> float:
    """Largest gap of a joint relative to the size of the system; refuse one that is more than rounding."""
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    if first.node.size != second.node.size or (first.components[0] == (0,)):
        return 0.0
    gap = joint_gap(substructures, placed, joint)
    if not as_built:
        gap = gap @ axes.T
        gap[:, [dof for dof in joint.free if dof < 3]] = 0.0
    size = reach(substructures)
    distance = np.linalg.norm(gap, axis=1)
    if distance.max() <= COINCIDENT * size:
        return float(distance.max() / size)
    here, there = first.position[0], second.position[0]
    for ratio, pair in _UNIT_RATIOS.items():
        for factor in (ratio, 1 / ratio):
            if np.linalg.norm(there - factor * here) <= 1e-4 * np.linalg.norm(there) > 0:
                raise UnitsError(
                    f"joint '{joint.name}': the coordinates of '{joint.second}' are {factor:g} times those of "
                    f"'{joint.first}', as {pair} are: state the units of both components (`units: mm-t-s`)"
                )
    k, order = int(np.argmax(distance)), _matching_order(substructures, placed, joint, COINCIDENT * size)
    advice = (
        f"List the nodes of '{joint.second}' in the order of those of '{joint.first}'{_listed(order)}"
        if order
        else "Move a body with `place:`, give a tie its `position:`, or give the joint an `offset:`"
    )
    where = f" at node {first.node[k]}" if first.node[k] >= 0 else ""
    raise SceneError(
        f"joint '{joint.name}': its interfaces lie {distance[k]:.6g} apart{where} "
        f"('{joint.first}' at {_xyz(first.position[k])}, '{joint.second}' at {_xyz(second.position[k])} in their basic "
        f"frames); they must coincide to {COINCIDENT * size:.2g}. {advice}"
    )


def _listed(order: list[int]) -> str:
    """Nodes as the key takes them, if they are few enough to be copied from a message."""
    return f": nodes: [{', '.join(map(str, order))}]" if len(order) <= _COPIED else f", {len(order)} of either"


def _matching_order(
    substructures: Mapping[str, Substructure], placed: Mapping[str, Placement], joint: Joint, near: float
) -> list[int]:
    """Nodes of the second interface, each where its node of the first lies; empty if they do not pair up."""
    from scipy.spatial import cKDTree

    face = interface_at(substructures, joint.second)
    there = face.position @ placed[joint.second.body].rotation.T
    away, partner = cKDTree(there).query(there - joint_gap(substructures, placed, joint))
    pairs = np.max(away) <= near and np.unique(partner).size == partner.size > 1
    return face.node[partner].tolist() if pairs else []


def reach(substructures: Mapping[str, Substructure]) -> float:
    """Size of the system, by the coordinates of its points."""
    places = np.vstack([x for sub in substructures.values() for x in sub.position.values()])
    return max(float(np.ptp(places, axis=0).max()), float(abs(places).max()), 1e-300)


def _xyz(x: Array) -> str:
    return "(" + ", ".join(f"{value:g}" for value in x) + ")"
