"""Exudyn: a Python script that builds and runs the scene, and the arrays of each body beside it.

Source: the Exudyn documentation, ObjectFFRFreducedOrder, MarkerSuperElementRigid and GenericJoint (version 1.13).
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import (
    FIRST_ROTATION,
    Channel,
    JointTerm,
    MultibodyScene,
    Point,
    PointTerm,
    SceneBody,
    SceneJoint,
    StrutTerm,
)
from cmsreduce.write.component import FlexibleBody
from cmsreduce.write.export.body_frame import BodyFrame, point_position, rendered
from cmsreduce.write.export.first_slew import FirstSlew, first_slew
from cmsreduce.write.files import atomic_path
from cmsreduce.write.targets import exudyn_arrays

__all__ = ["write_exudyn_scene"]

_SIX = 6
_ALL_TURN = 3

Array = NDArray[np.float64]


def write_exudyn_scene(folder: Path, scene: MultibodyScene) -> tuple[Path, ...]:
    """Write scene.py and an .npz file for each body that differs from the others.

    Parameters
    ----------
    folder : Path
        Folder of the files.
    scene : MultibodyScene
        In the configuration in which the simulation starts, at rest.

    Returns
    -------
    tuple of Path
        The script first.

    Raises
    ------
    WriteError
        If a body or a joint has no form in Exudyn.
    """
    bodies = {body.name: BodyFrame.of(body, slow=True) for body in scene.bodies}
    written: dict[Path, Path] = {}
    for body in scene.bodies:
        reduced = bodies[body.name].reduced
        if body.file is None or reduced is None or body.file in written:
            continue
        path = folder / f"{body.file.stem}.npz"
        _write_body(path, reduced)
        written[body.file] = path
    names = {body.name: written[body.file].name for body in scene.bodies if body.file is not None}
    script = folder / "scene.py"
    with atomic_path(script) as temporary:
        temporary.write_text(_script(scene, bodies, names, first_slew(scene)), encoding="utf-8")
    return (script, *written.values())


def _write_body(path: Path, body: FlexibleBody) -> None:
    """Arrays of a body; six points about each node that its slopes move let joints and torques turn with it."""
    reach = max(float(np.ptp(body.position, axis=0).max(initial=0.0)), float(abs(body.position).max(initial=0.0)), 1.0)
    arms = reach * np.vstack([np.eye(3), -np.eye(3)])
    # A rotation r moves the end of an arm a by r x a. Unknown slopes are zero: such a point turns with the frame.
    swung = np.cross(body.rotation[:, None, :, :], arms[None, :, :, None], axisa=2, axisb=2, axisc=2)
    around = (body.position[:, None, :] + arms).reshape(-1, 3)
    moved = (body.translation[:, None] + swung).reshape(-1, 3, body.k)
    extended = replace(
        body,
        node=np.arange(7 * body.node.size),
        position=np.vstack([body.position, around]),
        translation=np.concatenate([body.translation, moved]),
    )
    arrays = exudyn_arrays(extended) | {"modalDamping": body.damping, "nodeIds": body.node}
    image = io.BytesIO()
    np.savez(image, **arrays)
    with atomic_path(path) as temporary:
        temporary.write_bytes(image.getvalue())


def _script(scene: MultibodyScene, bodies: dict[str, BodyFrame], names: dict[str, str], slew: FirstSlew) -> str:
    laws = [
        (repr(each.name), f"slew({slew.effort!r})" if each.name == slew.actuator else "off") for each in scene.actuators
    ]
    units = scene.scene.units.name
    # The class of the first template goes on in the second.
    return rendered(
        "exudyn_scene.py.j2",
        title=_text(f"Scene '{scene.name}' for Exudyn, at rest in the configuration '{scene.configuration.name}'."),
        units=units,
        seconds=repr(slew.seconds),
        seconds_why=slew.seconds_why,
        step=repr(slew.step),
        step_why=slew.step_why,
        laws=laws,
        configuration=_text(repr(scene.configuration.name)),
        lines=[
            *_body_lines(scene, bodies, names),
            *_ground_lines(scene, bodies),
            *(line for joint in scene.joints for line in _joint_lines(scene, bodies, joint)),
            *(line for each in scene.actuators for line in _actuator_lines(scene, bodies, each)),
            *(line for each in scene.sensors for line in _sensor_lines(scene, bodies, each)),
        ],
    ) + rendered("exudyn_channels.py.j2")


def _text(words: str) -> str:
    """Words that stand in a docstring."""
    return words.replace("\\", "/").replace('"', "'")


def _body_lines(scene: MultibodyScene, bodies: dict[str, BodyFrame], names: dict[str, str]) -> Iterator[str]:
    for body in scene.bodies:
        frame, R = bodies[body.name], body.placement.rotation
        position, rotation = _plain(scene.in_scene(body.name, frame.origin)), _plain(R @ frame.axes.T)
        if body.rigid is not None:
            mass = f"{body.rigid.mass!r}, {_plain(body.rigid.inertia)}"
            yield f"scene.rigid({body.name!r}, {mass}, {position}, {rotation})"
            continue
        held = ", held=True" if frame.held else ""
        yield f"scene.flexible({body.name!r}, {names[body.name]!r}, {position}, {rotation}{held})"


def _ground_lines(scene: MultibodyScene, bodies: dict[str, BodyFrame]) -> Iterator[str]:
    for point in scene.ground:
        body = scene.body(point.body)
        face = body.interfaces[point.name]
        for k in range(face.node.size):
            axes = face.node_frame(k)
            place = _plain(scene.in_scene(point.body, face.position[k])), _plain(axes @ body.placement.rotation.T)
            held = sorted({max(component - 1, 0) for component in face.components[k]})
            ground = f"scene.on_ground({place[0]}, {place[1]})"
            on_body = _point(bodies, body, int(face.node[k]), face.position[k], axes)
            yield f"scene.lock({ground}, scene.point{on_body}, {held})  # {point}"


def _joint_lines(scene: MultibodyScene, bodies: dict[str, BodyFrame], placed: SceneJoint) -> Iterator[str]:
    name = placed.joint.name
    sides = _Sides(scene, bodies, placed)
    for k, locked in enumerate(placed.locked):
        a, b = sides.first(placed.first_axes, k), sides.second(placed.second_axes, k)
        if placed.cross is None:
            yield f"scene.join({name!r}, {a}, {b}, {list(locked)})"
            continue
        earlier, later = placed.cross
        a2, b2 = (of(_triad(placed.second_axes, earlier, later)) for of in (sides.first_now, sides.second))
        yield f"scene.join({name!r}, {a}, {b}, {[dof for dof in locked if dof < FIRST_ROTATION]})"
        held = any(dof >= FIRST_ROTATION for dof in locked)
        yield f"scene.cross({name!r}, {a2}, {b2}, {FIRST_ROTATION + earlier}, {held})"
    yield from _element_lines(scene, placed, sides)


class _Sides:
    """Points of both sides of a joint as text, by axes that are rows in the basic frame of their body."""

    def __init__(self, scene: MultibodyScene, bodies: dict[str, BodyFrame], placed: SceneJoint) -> None:
        self.bodies, self.arms = bodies, placed.arms
        ends = placed.joint.first, placed.joint.second
        self.body = tuple(scene.body(point.body) for point in ends)
        self.face = tuple(body.interfaces[point.name] for body, point in zip(self.body, ends, strict=True))

    def first(self, axes: Array, k: int = 0) -> str:
        """A node of the first interface, at the end of the rigid arm to the second."""
        face = self.face[0]
        return _point(self.bodies, self.body[0], int(face.node[k]), face.position[k], axes, self.arms[k])

    def first_now(self, axes: Array) -> str:
        """The first node of the first interface; the axes are those of the second side, where they are now."""
        first, second = (body.placement.rotation for body in self.body)
        return self.first(axes @ second.T @ first)

    def second(self, axes: Array, k: int = 0) -> str:
        """A node of the second interface."""
        face = self.face[1]
        return _point(self.bodies, self.body[1], int(face.node[k]), face.position[k], axes)


def _triad(axes: Array, z: int, other: int) -> Array:
    """Axes of which the last is one of three, the second another one (3, 3)."""
    return np.array([np.cross(axes[other], axes[z]), axes[other], axes[z]])


def _element_lines(scene: MultibodyScene, placed: SceneJoint, sides: _Sides) -> Iterator[str]:
    """Springs, dampers and inertias of a joint, without force in this configuration."""
    joint, name = placed.joint, placed.joint.name
    turns = [dof - FIRST_ROTATION for dof in joint.free if dof >= FIRST_ROTATION]
    figures, inertia = np.zeros((2, _SIX)), np.zeros(_SIX)
    for element in joint.elements:
        inertia[element.dof] = element.inertia
        figures[:, element.dof] = element.stiffness, element.damping
        own = f"{element.stiffness!r}, {element.damping!r}"
        axis = element.dof % FIRST_ROTATION
        if not element.stiffness and not element.damping:
            continue
        if element.dof < FIRST_ROTATION:
            yield f"scene.spring({name!r}, {axis}, {own})"
        elif len(turns) < _ALL_TURN:
            axes = _triad(placed.second_axes, axis, (axis + 1) % FIRST_ROTATION)
            ends = f"{sides.first_now(axes)}, {sides.second(axes)}"
            if placed.cross is None:
                yield f"scene.torsion({ends}, {own})"
            else:
                yield f"scene.cross_spring({name!r}, {ends}, {element.dof}, {own})"
    if len(turns) == _ALL_TURN and figures[:, FIRST_ROTATION:].any():
        yield f"scene.torsions({name!r}, {_plain(figures[0, FIRST_ROTATION:])}, {_plain(figures[1, FIRST_ROTATION:])})"
    if inertia.any():
        body = scene.body(joint.first.body)
        face = body.interfaces[joint.first.name]
        place = _plain(scene.in_scene(body.name, face.position[0]))
        axes = _plain(body.placement.rotation @ placed.first_axes.T)
        point = _point(sides.bodies, body, int(face.node[0]), face.position[0], placed.first_axes)
        yield f"scene.turning_mass({joint.own_body!r}, {_plain(inertia[3:])}, {place}, {axes}, {point})"


def _actuator_lines(scene: MultibodyScene, bodies: dict[str, BodyFrame], channel: Channel) -> Iterator[str]:
    name = repr(channel.name)
    for term in channel.terms:
        match term:
            case JointTerm(joint, dof):
                yield f"scene.drive({name}, {joint!r}, {dof})"
            case PointTerm(at, direction):
                yield f"scene.push({name}, {_at(scene, bodies, at)}, {_plain(bodies[at.body].weights(direction))})"
            case StrutTerm(a, b):
                ends = (_at(scene, bodies, point) for point in (a, b))
                yield f"scene.stretch({name}, {', '.join(f'({end})' for end in ends)})"


def _sensor_lines(scene: MultibodyScene, bodies: dict[str, BodyFrame], channel: Channel) -> Iterator[str]:
    name, rate = repr(channel.name), channel.rate
    for term in channel.terms:
        match term:
            case JointTerm(joint, dof):
                yield f"scene.sense_joint({name}, {joint!r}, {dof}, {rate})"
            case PointTerm(at, direction):
                direct = _plain(bodies[at.body].weights(direction))
                yield f"scene.sense({name}, {_at(scene, bodies, at)}, {direct}, {rate})"
            case StrutTerm(a, b):
                ends = (_at(scene, bodies, point) for point in (a, b))
                yield f"scene.sense_stretch({name}, {', '.join(f'({end})' for end in ends)}, {rate})"


def _at(scene: MultibodyScene, bodies: dict[str, BodyFrame], point: Point) -> str:
    """Body and node, or place in the frame of a rigid body, as text."""
    body = scene.body(point.body)
    if body.rigid is None:
        return f"{body.name!r}, {body.node(point.name)}"
    return f"{body.name!r}, {_plain(point_position(body, point) - bodies[body.name].origin)}"


def _point(
    bodies: dict[str, BodyFrame], body: SceneBody, node: int, position: Array, axes: Array, apart: Array | None = None
) -> str:
    """A point as the script takes it: body, node or place, axes, and a rigid arm where there is one."""
    frame = bodies[body.name]
    at = _plain(position - frame.origin) if body.rigid is not None else node
    arm = "" if apart is None or not apart.any() else f", {_plain(frame.axes @ apart)}"
    return f"({body.name!r}, {at}, {_plain(axes @ frame.axes.T)}{arm})"


def _plain(values: Array) -> Any:
    """Numbers as text has them, with all digits; zero has no sign."""
    return (np.asarray(values) + 0.0).tolist()
