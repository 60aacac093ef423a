"""Joints, ground, springs, dampers and inertias of a scene as elements of MBDyn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, JointElement, Point, SceneJoint
from cmsreduce.write.export.mbdyn_input import MbdynInput, Place, matrix, real, vector

__all__ = ["add_ground", "add_joint", "ends", "joint_motion"]

_MOTIONS = frozenset(range(6))
# Axis 3 of an element that turns about one axis is the axis 0..2 of the joint.
_AXIS_LAST = ((1, 2, 0), (2, 0, 1), (0, 1, 2))
# Of direction cosines: axes that were not turned differ by round-off.
_TURNED = 1e-9

Array = NDArray[np.float64]


def ends(deck: MbdynInput, placed: SceneJoint, k: int = 0) -> tuple[Place, Place]:
    """Both points of a pair of nodes, in one place at the start: the first at the end of the rigid arm of the joint."""
    return deck.of_interface(placed.joint.first, k).moved(placed.arms[k]), deck.of_interface(placed.joint.second, k)


def _hinge_axis(placed: SceneJoint) -> int | None:
    """Axis 0..2 of a joint that leaves one rotation free, and nothing else."""
    free = sorted(_MOTIONS - set(placed.locked[0]))
    return free[0] - FIRST_ROTATION if len(placed.locked) == 1 and free in ([3], [4], [5]) else None


def add_joint(deck: MbdynInput, placed: SceneJoint) -> None:
    """Add a hinge if one rotation is free, else the locked motions of each pair of nodes, with springs and inertias."""
    axis = _hinge_axis(placed)
    for k, locked in enumerate(placed.locked):
        first, second = ends(deck, placed, k)
        _refuse_turned_cross(placed, first, second)
        if any(dof >= FIRST_ROTATION for dof in locked):
            _require_slopes(placed, first, second)
        # Motions start from zero, with the axes as they are now.
        if axis is None:
            one, other = _total_end(first, placed.first_axes), _total_end(second, placed.second_axes)
            text = f"total joint, {one}, {other}{_constraints(locked)}"
        else:
            order = _AXIS_LAST[axis]
            text = f"revolute hinge, {_end(first, placed.first_axes, order)}, {_end(second, placed.second_axes, order)}"
        deck.element("joint", _label(deck, placed, k), text)
    _add_elements(deck, placed)


def _refuse_turned_cross(placed: SceneJoint, first: Place, second: Place) -> None:
    """Refuse two free rotations after a turn about the later axis: the total joint locks another rotation then."""
    if placed.cross is None:
        return
    seen = placed.second_axes @ second.body.placement.rotation.T @ first.body.placement.rotation
    if abs(seen - placed.first_axes).max() > _TURNED:
        later = DOF_NAMES[FIRST_ROTATION + placed.cross[1]]
        raise WriteError(
            f"joint '{placed.joint.name}': two rotations are free, and the configuration turns it about {later}; "
            "MBDyn's total joint would lock another rotation there than a universal joint. Export a configuration with "
            f"{later} at zero, or model the cross as a body between two hinges"
        )


def _require_slopes(placed: SceneJoint, *points: Place) -> None:
    for point in points:
        point.require_slope(f"joint '{placed.joint.name}'")


def _total_end(point: Place, axes: Array) -> str:
    turned = point.oriented(axes)
    offset = vector(point.offset)
    return f"{point.node}, position, {offset}, position orientation, {turned}, rotation orientation, {turned}"


def _constraints(locked: tuple[int, ...]) -> str:
    """Motions that a total joint holds at zero."""
    words = ""
    for name, first in (("position", 0), ("orientation", FIRST_ROTATION)):
        held = ["active" if first + k in locked else "inactive" for k in range(3)]
        if "active" in held:
            words += f", {name} constraint, {', '.join(held)}, null"
    return words


def _add_elements(deck: MbdynInput, placed: SceneJoint) -> None:
    """Springs and dampers, without force in the configuration, and inertias, which turn with the first interface."""
    joint = placed.joint
    turning = [dof for dof in joint.free if dof >= FIRST_ROTATION]
    acting = [element for element in joint.elements if element.stiffness or element.damping]
    alone = [element for element in acting if element.dof in turning and len(turning) == 1]
    for element in alone:
        _add_torsion(deck, placed, element)
    rest = [element for element in acting if element not in alone]
    if rest:
        first, second = ends(deck, placed)
        figures = np.zeros((2, 6))
        for element in rest:
            figures[:, element.dof] = element.stiffness, element.damping
        one = _end(first, placed.first_axes)
        other = _end(second, placed.second_axes)
        K, C = (", ".join(real(value) for value in row) for row in figures)
        law = f"linear viscoelastic generic, diag, {K}, diag, {C}"
        # A moment K v along the rotation vector v of a ball has a potential where K is the same about all axes.
        unlike = len(turning) == 3 and np.ptp(figures[0, FIRST_ROTATION:]) > 0
        about = f"{joint.name}: unlike springs of a ball do not keep the energy at large angles" if unlike else ""
        label = deck.label("spring", joint.name, about)
        deck.element("joint", label, f"deformable joint, {one}, {other}, {law}")
    diagonal = np.zeros(3)
    for element in joint.elements:
        if element.inertia:
            diagonal[element.dof - FIRST_ROTATION] = element.inertia
    if diagonal.any():
        first = deck.of_interface(joint.first)
        axes = placed.first_axes @ first.frame.axes.T
        if first.body.rigid is None:
            first.require_slope(f"inertia of joint '{joint.name}'")
            deck.heavy.add(first.node)
        J = ", ".join(real(value) for value in (axes.T @ np.diag(diagonal) @ axes).ravel())
        label = deck.label("inertia", joint.name, f"inertia of joint {joint.name}")
        deck.element("body", label, f"{first.node}, 0., null, matr, {J}")


def _add_torsion(deck: MbdynInput, placed: SceneJoint, element: JointElement) -> None:
    """A spring about the only axis that turns, which may turn by any angle."""
    first, second = ends(deck, placed)
    _require_slopes(placed, first, second)
    order = _AXIS_LAST[element.dof - FIRST_ROTATION]
    one = _end(first, placed.first_axes, order)
    other = _end(second, placed.second_axes, order)
    law = f"linear viscoelastic, {real(element.stiffness)}, {real(element.damping)}"
    label = deck.label("torsion", placed.joint.name, f"spring of joint {placed.joint.name}")
    deck.element("joint", label, f"deformable axial joint, {one}, {other}, {law}")


def _end(point: Place, axes: Array, order: tuple[int, int, int] = (0, 1, 2)) -> str:
    return f"{point.node}, position, {vector(point.offset)}, orientation, {point.oriented(axes, order)}"


def add_ground(deck: MbdynInput, point: Point) -> None:
    """Hold the dofs of an interface where they are."""
    face = deck.scene.body(point.body).interfaces[point.name]
    for k in range(face.node.size):
        place, axes = deck.of_interface(point, k), face.node_frame(k)
        held = tuple(sorted({max(component - 1, 0) for component in face.components[k]}))
        if any(dof >= FIRST_ROTATION for dof in held):
            place.require_slope(f"ground at {point}")
        turned = matrix((axes @ place.body.placement.rotation.T).T)
        there = f"position, {vector(place.in_scene)}, position orientation, {turned}, rotation orientation, {turned}"
        label = deck.label("ground", f"{point.body}_{point.name}_{k + 1}", f"ground at {point}")
        deck.element("joint", label, f"total pin joint, {_total_end(place, axes)}, {there}{_constraints(held)}")


def joint_motion(deck: MbdynInput, placed: SceneJoint, dof: int, *, rate: bool) -> str:
    """Drive of a motion of a joint since the start, or of its rate: the second side against the first."""
    turns = dof >= FIRST_ROTATION
    what = "vw"[turns] if rate else "pr"[turns]
    axis = "z" if _hinge_axis(placed) is not None else "xyz"[dof % 3]
    return f'element, {_label(deck, placed, 0)}, joint, string, "{what}{axis}", direct'


def _label(deck: MbdynInput, placed: SceneJoint, k: int) -> str:
    return deck.label("joint", placed.joint.name if len(placed.locked) == 1 else f"{placed.joint.name}_{k + 1}")
