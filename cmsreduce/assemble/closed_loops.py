"""Closed loops: settings of joints that close them, the motion of the joint that closes one, refusal of others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.joints import COINCIDENT, available, reach
from cmsreduce.assemble.placement import (
    Joined,
    carried_axes,
    interface_at,
    joint_axes,
    joint_gap,
    joint_tree,
    place_bodies,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, SCALAR, Configuration, Joint, Placement, Scene, Substructure

__all__ = ["check_loops", "closing_motion", "nearest_closed"]

Array = NDArray[np.float64]
Motion = tuple[str, int]
"""Joint and its motion 0..5."""

# Gauss-Newton doubles the digits with each step; a loop that is open after these cannot be closed nearby.
_STEPS = 30
_STEP = 1e-6  # of a radian or of the size of the system: of central differences, which then err by 1e-12
# Singular values below this share of the largest do not steer: a loop at its dead centre, or locked twice.
_STEERS = 1e-6
# Angles are given in degrees of eight digits: a smaller motion of a joint that closes a loop is none.
_NO_MOTION = 1e-7


def check_loops(
    substructures: Mapping[str, Substructure],
    scene: Scene,
    configuration: Configuration,
    placed: Mapping[str, Placement],
) -> None:
    """Refuse configurations that leave a closed loop open.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        All bodies.
    scene : Scene
        Joints; inboard joints of bodies are turned by their own angles, and fit.
    configuration : Configuration
        If it turns a locked joint, it describes a held position, in which loops need not fit in rotation.
    placed : mapping of body to Placement
        Positions of the bodies in it.

    Raises
    ------
    SceneError
        With the joint, the distance or the angle by which it does not fit, and settings that close the loop.
    """
    free = {joint.name: joint.free for joint in scene.joints}
    held = any(dof not in free[name] for name, dof in configuration.angles)
    size = reach(substructures)
    for joint in _closing(scene):
        gap, turn = _misfit(substructures, scene, placed, joint)
        apart, turned = float(np.linalg.norm(gap)), float(abs(turn).max(initial=0.0))
        if apart > COINCIDENT * size:
            fault = f"leave '{joint.second}' {apart:.6g} from '{joint.first}', where {COINCIDENT * size:.2g} is allowed"
        elif turned > COINCIDENT and not held:
            fault = f"turn '{joint.second}' by {turned:.3g} rad against '{joint.first}' where it is locked"
        else:
            continue
        raise SceneError(
            f"configuration '{configuration.name}': joint '{joint.name}' closes a loop, and the angles of the other "
            f"joints {fault}: {_advice(substructures, scene, configuration)}{_two_at_rest(scene)}"
        )
    for joint in () if held else _closing(scene):
        _check_given(substructures, scene, configuration, placed, joint)


def _check_given(
    substructures: Mapping[str, Substructure],
    scene: Scene,
    configuration: Configuration,
    placed: Mapping[str, Placement],
    joint: Joint,
) -> None:
    """Refuse a value of a joint that closes a loop, if it is not the one that follows from the other joints."""
    given = {
        dof: configuration.angles[joint.name, dof] for dof in range(6) if (joint.name, dof) in configuration.angles
    }
    found = closing_motion(substructures, scene, placed, joint)
    wanted = found.copy()
    wanted[list(given)] = list(given.values())
    turn = abs(_rotation(wanted[3:]) - _rotation(found[3:])).max()
    if max(abs(wanted - found)[:3].max() / reach(substructures), turn) > COINCIDENT:
        raise SceneError(
            f"configuration '{configuration.name}': joint '{joint.name}' closes a loop, so that its motion follows "
            f"from the other joints: {', '.join(_shown(joint.name, dof, found[dof]) for dof in given)}; give "
            f"these values, or take them out{_two_at_rest(scene)}"
        )


def closing_motion(bodies: Mapping[str, Joined], scene: Scene, placed: Mapping[str, Placement], joint: Joint) -> Array:
    """Motion x y z rx ry rz (6,) of the second side of a joint against the first, since the bodies were built.

    Parameters
    ----------
    bodies : mapping of name to Joined
        All bodies.
    scene : Scene
        Placements as built.
    placed : mapping of body to Placement
        Positions of the bodies.
    joint : Joint
        One that closes a loop, so that its motion follows from the other joints. Locked motions are zero.
    """
    found, faces = np.zeros(6), [interface_at(bodies, point) for point in (joint.first, joint.second)]
    if any(face.node.size != 1 or face.components[0] == (SCALAR,) for face in faces):
        return found
    axes = joint_axes(bodies, placed, joint)
    way = axes @ joint_gap(bodies, placed, joint)[0]
    # Column j: axis j, carried by the second side, along the axes of the first.
    Q = axes @ carried_axes(bodies, scene, placed, joint).T
    turning = sorted(dof - FIRST_ROTATION for dof in joint.free if dof >= FIRST_ROTATION)
    for dof in joint.free:
        if dof < FIRST_ROTATION:
            found[dof] = way[dof]
    if len(turning) == len(Q):
        # Loaded by few commands.
        from scipy.spatial.transform import Rotation

        found[3:] = Rotation.from_matrix(Q).as_euler("xyz")
    elif len(turning) == 2:
        # A turn about the earlier axis, then one about the later.
        (first, last), other = turning, 3 - sum(turning)
        sign = -1.0 if last - first == 1 else 1.0
        found[3 + first] = sign * np.arctan2(Q[last, other], Q[last, last])
        found[3 + last] = sign * np.arctan2(Q[other, first], Q[first, first])
    elif turning:
        i, j = (turning[0] + 1) % 3, (turning[0] + 2) % 3
        found[3 + turning[0]] = np.arctan2(Q[j, i], Q[i, i])
    size = max(float(abs(face.position).max()) for face in faces)
    found[abs(found) <= _NO_MOTION * np.repeat([size, 1.0], 3)] = 0.0
    return found


def _rotation(angles: Array) -> Array:
    """Turn about x, then y, then z."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_euler("xyz", angles).as_matrix())


def nearest_closed(
    substructures: Mapping[str, Substructure],
    scene: Scene,
    configuration: Configuration,
    fixed: frozenset[Motion] = frozenset(),
) -> Configuration | None:
    """Find the nearest settings that close every loop, by the least change of the joints (Gauss-Newton).

    Parameters
    ----------
    substructures : mapping of name to Substructure
        All bodies.
    scene : Scene
        Joints, placements as built.
    configuration : Configuration
        Where to start.
    fixed : frozenset of (joint, dof)
        Settings that stay.

    Returns
    -------
    Configuration or None
        The same one if it closes them; None if there is none nearby.
    """
    closing, (_, inboard_of) = _closing(scene), joint_tree(scene)
    size, motions = reach(substructures), []
    for joint in inboard_of.values():
        motions += [(joint.name, dof) for dof in sorted(joint.free) if (joint.name, dof) not in fixed]
    unit = np.array([1.0 if dof >= FIRST_ROTATION else size for _, dof in motions])

    def at(change: Array) -> Configuration:
        moved = {axis: configuration.angles.get(axis, 0.0) + float(c) for axis, c in zip(motions, change, strict=True)}
        return replace(configuration, angles={**configuration.angles, **moved})

    def misfit(change: Array) -> Array:
        placed = place_bodies(substructures, scene, at(change))
        parts = [_misfit(substructures, scene, placed, joint) for joint in closing]
        return np.concatenate([np.concatenate([gap / size, turn]) for gap, turn in parts] or [np.zeros(0)])

    change, left = np.zeros(len(motions)), misfit(np.zeros(len(motions)))
    if abs(left).max(initial=0.0) <= COINCIDENT:
        return _with_closing(substructures, scene, configuration)
    if not motions:
        return None
    for _ in range(_STEPS):
        steps = np.diag(_STEP * unit)
        J = np.array([(misfit(change + step) - misfit(change - step)) / (2 * _STEP) for step in steps]).T
        change = change - unit * (np.linalg.pinv(J, rcond=_STEERS) @ left)
        left = misfit(change)
        if abs(left).max() <= COINCIDENT**2:
            break
    return _with_closing(substructures, scene, at(change)) if abs(left).max() <= COINCIDENT else None


def _with_closing(
    substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration
) -> Configuration:
    """The same configuration; joints that close loops have the motion that follows, where they have one."""
    closing = {joint.name: joint for joint in _closing(scene)}
    given = [(name, dof) for name, dof in configuration.angles if name in closing]
    if not given:
        return configuration
    placed = place_bodies(substructures, scene, configuration)
    motions = {name: closing_motion(substructures, scene, placed, closing[name]) for name, _ in given}
    return replace(
        configuration, angles={**configuration.angles, **{(name, dof): motions[name][dof] for name, dof in given}}
    )


def _closing(scene: Scene) -> list[Joint]:
    """Joints that close loops: those that are no body's inboard joint."""
    inboard = {joint.name for joint in joint_tree(scene)[1].values()}
    return [joint for joint in scene.joints if joint.name not in inboard]


def _misfit(
    substructures: Mapping[str, Substructure], scene: Scene, placed: Mapping[str, Placement], joint: Joint
) -> tuple[Array, Array]:
    """Way between the sides of a joint along locked axes, and how they are turned beyond its freedom.

    The second are differences of direction cosines.
    """
    axes = joint_axes(substructures, placed, joint)
    first, second = (interface_at(substructures, point) for point in (joint.first, joint.second))
    if first.node.size != second.node.size or first.components[0] == (SCALAR,):
        return np.zeros(0), np.zeros(0)
    gap = joint_gap(substructures, placed, joint) @ axes.T
    gap[:, [dof for dof in joint.free if dof < FIRST_ROTATION]] = 0.0
    # Relative rotation since the bodies were built, along the joint's axes.
    Q = axes @ carried_axes(substructures, scene, placed, joint).T
    can = available(first, 0, axes @ placed[joint.first.body].rotation)
    free = [dof - 3 for dof in range(3, 6) if dof in joint.free or not can[dof]]
    if len(free) == 2:
        # Rotations about the earlier axis come first, so that these two axes remain normal to each other.
        return gap.ravel(), Q[free[1], free[0]].reshape(1)
    kept = {0: np.eye(3), 1: np.eye(3)[:, free], 3: np.zeros((3, 0))}[len(free)]
    return gap.ravel(), (Q @ kept - kept).ravel()


def _advice(substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration) -> str:
    """Settings that close the loops: of the joints without one, else of all."""
    for fixed in (frozenset(configuration.angles), frozenset[Motion]()):
        closed = nearest_closed(substructures, scene, configuration, fixed)
        if closed is None or closed is configuration:
            continue
        shown = [
            _shown(name, dof, value)
            for (name, dof), value in closed.angles.items()
            if (name, dof) in configuration.angles or abs(value) > _STEP
        ]
        return f"they fit at {', '.join(shown)}"
    return "give angles that fit, or free it there"


def _two_at_rest(scene: Scene) -> str:
    """Remark on a base that is not on the ground: joints between the two are those of a loop."""
    grounded = list(dict.fromkeys(point.body for point in scene.ground))
    if not grounded or scene.base in grounded:
        return ""
    return (
        f". Neither the base '{scene.base}' nor '{grounded[0]}', which is on the ground, moves: with "
        f"`base: {grounded[0]}` the joints between them turn the former"
    )


def _shown(name: str, dof: int, value: float) -> str:
    return f"{name}.{DOF_NAMES[dof]}: " + (f"{np.degrees(value):.8g} deg" if dof >= FIRST_ROTATION else f"{value:.8g}")
