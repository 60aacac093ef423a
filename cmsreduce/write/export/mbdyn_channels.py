"""Actuators and sensors of a scene in MBDyn: laws that the user edits, the elements they drive, and output drives."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import FIRST_ROTATION, Channel, JointTerm, PointTerm, StrutTerm
from cmsreduce.write.export.first_slew import FirstSlew
from cmsreduce.write.export.mbdyn_input import MbdynInput, Place, matrix, quoted, real, vector
from cmsreduce.write.export.mbdyn_joints import ends, joint_motion

__all__ = ["actuator_laws", "add_actuator", "add_sensor"]


Array = NDArray[np.float64]


def actuator_laws(deck: MbdynInput, slew: FirstSlew) -> Iterator[str]:
    """Efforts over time, one card for each actuator."""
    sine = f'string, "{real(slew.effort)}*sin(2.*pi*Time/SECONDS)"'
    for channel in deck.scene.actuators:
        label = deck.label("actuator", channel.name, f"law of {channel.name}")
        law = sine if channel.name == slew.actuator else "null"
        yield f"drive caller: {label}, name, {quoted(channel.name)}, {law};"


def add_actuator(deck: MbdynInput, channel: Channel) -> None:
    """Add the forces and couples of an actuator.

    Raises
    ------
    WriteError
        If MBDyn has no element for it.
    """
    law = f"reference, {deck.label('actuator', channel.name)}"
    for number, term in enumerate(channel.terms, start=1):
        name = channel.name if len(channel.terms) == 1 else f"{channel.name}_{number}"
        match term:
            case PointTerm(at, direction):
                place = deck.place(at)
                force, couple = place.along(direction[:3]), place.along(direction[3:])
                if force.any():
                    text = f"follower, {place.node}, position, {vector(place.offset)}, {vector(force)}, {law}"
                    deck.element("force", deck.label("force", name), text)
                if couple.any():
                    place.require_slope(f"actuator '{channel.name}'")
                    text = f"follower, {place.node}, {vector(couple)}, {law}"
                    deck.element("couple", deck.label("couple", name), text)
            case JointTerm(joint, dof):
                _push_joint(deck, name, joint, dof, law)
            case StrutTerm(a, b):
                _push_strut(deck, name, deck.place(a), deck.place(b), law)


def _push_joint(deck: MbdynInput, name: str, joint: str, dof: int, law: str) -> None:
    """Opposite efforts on both sides of a joint, along an axis of the first side; MBDyn's act on the first one."""
    placed = deck.joint(joint)
    first, second = ends(deck, placed)
    axis = vector(-first.along(placed.first_axes[dof % 3]))
    if dof >= FIRST_ROTATION:
        for place in (first, second):
            place.require_slope(f"actuator '{name}'")
        text = f"follower internal, {first.node}, {second.node}, {axis}, {law}"
        deck.element("couple", deck.label("couple", name), text)
        return
    if len([free for free in placed.joint.free if free < FIRST_ROTATION]) > 1:
        raise WriteError(
            f"joint '{joint}': two translations are free, and MBDyn's pair of forces along one of them would not "
            "stay on one line; let the actuator act between two points instead (`between`)"
        )
    # Both forces act at the second side, on one line, so that they have no moment.
    ends_of = f"{first.node}, position, {vector(first.offset)}, {second.node}, position, {vector(second.offset)}"
    deck.element("force", deck.label("force", name), f"follower internal, {ends_of}, {axis}, {law}")


def _rod(a: Place, b: Place) -> str:
    return f"rod, {a.node}, position, {vector(a.offset)}, {b.node}, position, {vector(b.offset)}, from nodes"


def _length(a: Place, b: Place) -> float:
    return float(np.linalg.norm(b.in_scene - a.in_scene))


def _push_strut(deck: MbdynInput, name: str, a: Place, b: Place, law: str) -> None:
    """A rod of unit stiffness, whose prestrain is its own strain and the effort: the effort is left, as thrust."""
    measure = deck.label("length", name, f"length of {name}")
    deck.element("joint", measure, f"{_rod(a, b)}, linear elastic, 0.")
    strain = f'element, {measure}, joint, string, "L", linear, -1., {real(1 / _length(a, b))}'
    thrust = f"linear elastic, 1., prestrain, single, array, 2, {strain}, {law}"
    deck.element("joint", deck.label("strut", name), f"{_rod(a, b)}, {thrust}")


def add_sensor(deck: MbdynInput, channel: Channel) -> None:
    """Add the output drive of a sensor, and the nodes and elements that it reads."""
    parts: list[str] = []
    for number, term in enumerate(channel.terms, start=1):
        name = channel.name if len(channel.terms) == 1 else f"{channel.name}_{number}"
        match term:
            case PointTerm(at, direction):
                place = deck.place(at)
                weights = np.r_[place.along(direction[:3]), place.along(direction[3:])]
                if weights[3:].any():
                    place.require_slope(f"sensor '{channel.name}'")
                parts += (_rates if channel.rate else _motions)(deck, place, weights)
            case JointTerm(joint, dof):
                parts.append(joint_motion(deck, deck.joint(joint), dof, rate=channel.rate))
            case StrutTerm(a, b):
                points = deck.place(a), deck.place(b)
                measure = deck.label("length", f"{name}_seen", f"length of {name}")
                deck.element("joint", measure, f"{_rod(*points)}, linear elastic, 0.")
                what, start = ("LPrime", 0.0) if channel.rate else ("L", -_length(*points))
                parts.append(f'element, {measure}, joint, string, "{what}", linear, {real(start)}, 1.')
    value = parts[0] if len(parts) == 1 else f"array, {len(parts)}, " + ", ".join(parts)
    label = deck.label("sensor", channel.name)
    deck.drives.append(f"drive caller: {label}, name, {quoted(channel.name)}, {value}, output, yes;")


def _rates(deck: MbdynInput, place: Place, weights: Array) -> Iterator[str]:
    """Velocity and angular velocity along the axes of the node."""
    node = place.node
    if place.offset.any():
        node = deck.label("point", place.name)
        deck.dummies[node] = f"dummy, {place.node}, offset, {vector(place.offset)}, eye"
    return _weighed(node, ("xP", "omega"), weights)


def _motions(deck: MbdynInput, place: Place, weights: Array) -> Iterator[str]:
    """Displacement and rotation since the start, along the axes of the node: it sees the start go the other way."""
    start, seen = (
        deck.label("start", place.name),
        deck.label("seen", place.name, f"start of {place.name}, as it sees it"),
    )
    if start not in deck.carriers:
        deck.carriers[start] = f"static, {vector(place.in_scene)}, {matrix(place.axes_in_scene)}, null, null"
        clamp = deck.label("clamp", place.name, f"ground of {start}")
        deck.element("joint", clamp, f"clamp, {start}, node, node")
        deck.dummies[seen] = f"dummy, {start}, relative frame, {place.node}, position, {vector(place.offset)}"
    return _weighed(seen, ("X", "Phi"), -weights)


def _weighed(node: str, names: tuple[str, str], weights: Array) -> Iterator[str]:
    for k, weight in enumerate(weights):
        if weight:
            yield f'node, {node}, structural, string, "{names[k // 3]}[{k % 3 + 1}]", linear, 0., {real(weight)}'
