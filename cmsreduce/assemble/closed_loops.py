"""Closed loops: settings of joints that close them, and the refusal of others."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.joints import COINCIDENT, available, reach
from cmsreduce.assemble.placement import (
    carried_axes,
    interface_at,
    joint_axes,
    joint_gap,
    joint_tree,
    place_bodies,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, SCALAR, Configuration, Joint, Placement, Scene, Substructure

__all__ = ["check_loops", "nearest_closed"]

Array = NDArray[np.float64]
Motion = tuple[str, int]
"""Joint and its motion 0..5."""

# Gauss-Newton doubles the digits with each step; a loop that is open after these cannot be closed nearby.
_STEPS = 30
_STEP = 1e-6  # of a radian or of the size of the system: of central differences, which then err by 1e-12
# Singular values below this share of the largest do not steer: a loop at its dead centre, or locked twice.
_STEERS = 1e-6


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
            f"joints {fault}: {_advice(substructures, scene, configuration)}"
        )


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
        return configuration
    if not motions:
        return None
    for _ in range(_STEPS):
        steps = np.diag(_STEP * unit)
        J = np.array([(misfit(change + step) - misfit(change - step)) / (2 * _STEP) for step in steps]).T
        change = change - unit * (np.linalg.pinv(J, rcond=_STEERS) @ left)
        left = misfit(change)
        if abs(left).max() <= COINCIDENT**2:
            break
    return at(change) if abs(left).max() <= COINCIDENT else None


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
            f"{name}.{DOF_NAMES[dof]}: " + (f"{np.degrees(value):.8g} deg" if dof >= FIRST_ROTATION else f"{value:.8g}")
            for (name, dof), value in closed.angles.items()
            if (name, dof) in configuration.angles or abs(value) > _STEP
        ]
        return f"they fit at {', '.join(shown)}"
    return "give angles that fit, or free it there"
