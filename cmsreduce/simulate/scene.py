"""The system of a scene: its bodies placed, joints between their points, springs, actuators and sensors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, not_among
from cmsreduce.model import (
    DOF_NAMES,
    Channel,
    JointTerm,
    MultibodyScene,
    Point,
    PointTerm,
    SceneJoint,
)
from cmsreduce.simulate.balls import Ball
from cmsreduce.simulate.floating_body import FloatingBody, Marker
from cmsreduce.simulate.joints import Connection, Side, locked_rotations
from cmsreduce.simulate.movements import Element, JointMotion, Movement, PointMotion, StrutMotion
from cmsreduce.simulate.system import MultibodySystem

__all__ = ["scene_system"]

Array = NDArray[np.float64]


def scene_system(
    scene: MultibodyScene, bodies: Mapping[str, FloatingBody], gravity: Sequence[float] = (0.0, 0.0, 0.0)
) -> MultibodySystem:
    """Build the system of a scene.

    Parameters
    ----------
    scene : MultibodyScene
        Bodies where they are at the start.
    bodies : mapping of name to FloatingBody
        Flexible bodies, their points by node; rigid ones are made of the scene.
    gravity : (3,) sequence of float
        Acceleration of free fall along the axes of the scene.

    Returns
    -------
    MultibodySystem
        Movements are the free motions of joints, then the actuators, then the sensors.

    Raises
    ------
    SceneError
        If a joint has no place on a body, or an interface can move in a part of the three directions only.
    """
    return _Builder(scene, bodies).system(gravity)


class _Builder:
    def __init__(self, scene: MultibodyScene, bodies: Mapping[str, FloatingBody]) -> None:
        self.scene = scene
        self.names = [body.name for body in scene.bodies]
        self.bodies = [
            bodies[body.name] if body.rigid is None else FloatingBody.rigid(body.rigid, scene.configuration.parameters)
            for body in scene.bodies
        ]
        self.places = []
        for body, record in zip(self.bodies, scene.bodies, strict=True):
            place = record.placement
            self.places.append((place.rotation @ body.origin + place.translation, place.rotation @ body.axes.T))
        self.connections: list[Connection] = []
        self.by_joint: dict[str, int] = {}

    def system(self, gravity: Sequence[float]) -> MultibodySystem:
        for joint in self.scene.joints:
            self.by_joint[joint.joint.name] = len(self.connections)
            self.connections += self._joined(joint)
        for point in self.scene.ground:
            self.connections += self._grounded(point)
        for number, body in enumerate(self.bodies):
            if body.held:
                none = np.zeros((3, body.k))
                side = Side(number, Marker(np.zeros(3), none, none), np.eye(3))
                self.connections.append(self._to_ground(f"ground of {body.name}", side, range(6)))
        movements: list[Movement] = []
        elements, inertias, balls = [], [], []
        for joint in self.scene.joints:
            number = self.by_joint[joint.joint.name]
            at = {dof: len(movements) + i for i, dof in enumerate(sorted(joint.joint.free))}
            movements += [
                Movement(f"{joint.joint.name}.{DOF_NAMES[dof]}", (JointMotion(number, dof),), self._value(joint, dof))
                for dof in at
            ]
            turns = tuple(at[dof] for dof in sorted(at) if dof >= 3)
            if len(turns) == 3:
                sprung = any(e.stiffness and e.dof >= 3 for e in joint.joint.elements)
                balls.append(Ball(joint.joint.name, number, turns, sprung))
            for element in joint.joint.elements:
                if element.stiffness or element.damping:
                    rest = self._value(joint, element.dof)
                    elements.append(Element(at[element.dof], element.stiffness, element.damping, rest))
                if element.inertia:
                    side = self.connections[number].first
                    axis = side.axes[element.dof - 3]
                    row = np.concatenate([np.zeros(3), axis, axis @ side.marker.rotation])
                    inertias.append((side.body, row, element.inertia))
        movements += [self._movement(channel) for channel in (*self.scene.actuators, *self.scene.sensors)]
        return MultibodySystem(
            self.bodies, self.places, self.connections, movements, elements, inertias, gravity, balls
        )

    @staticmethod
    def _value(joint: SceneJoint, dof: int) -> float:
        """Motion of the second side relative to the first at the start; configurations move the outboard body."""
        return float(joint.values[dof]) * (-1.0 if joint.outboard == joint.joint.first.body else 1.0)

    def _marker(self, point: Point) -> tuple[int, Marker]:
        """Body and marker of a point: a node of a flexible body, an interface or ``cg`` of a rigid one."""
        number, record = self.names.index(point.body), self.scene.body(point.body)
        body = self.bodies[number]
        if record.rigid is None and not point.name.isdigit() and point.name not in record.interfaces:
            raise SceneError(f"'{point}': {not_among('interface', point.name, record.interfaces)}")
        key = point.name if record.rigid is not None else str(record.node(point.name))
        if key not in body.markers:
            raise SceneError(f"'{point}': {not_among('point', key, body.markers)}")
        return number, body.markers[key]

    def _sides(self, point: Point, axes: Array, arms: Array | None = None) -> list[Side]:
        """Sides of every node of an interface; axes and rigid arms are along the body's basic axes."""
        number, record = self.names.index(point.body), self.scene.body(point.body)
        body = self.bodies[number]
        keys = [point.name] if record.rigid is not None else [str(i) for i in record.interfaces[point.name].node]
        if arms is None:
            arms = np.zeros((len(keys), 3))
        return [
            Side(number, body.markers[key].on_arm(body.axes @ arm), axes @ body.axes.T)
            for key, arm in zip(keys, arms, strict=True)
        ]

    def _joined(self, joint: SceneJoint) -> list[Connection]:
        first = self._sides(joint.joint.first, joint.first_axes, joint.arms)
        second = self._sides(joint.joint.second, joint.second_axes)
        return [
            Connection(joint.joint.name, a, b, *_locks(locked))
            for a, b, locked in zip(first, second, joint.locked, strict=True)
        ]

    def _grounded(self, point: Point) -> list[Connection]:
        face, found = self.scene.body(point.body).interfaces[point.name], []
        for side, components in zip(self._sides(point, np.eye(3)), face.components, strict=True):
            if set(components) not in ({1, 2, 3}, {1, 2, 3, 4, 5, 6}):
                raise SceneError(
                    f"ground: '{point}' has the dofs {''.join(map(str, components))}; a simulation in space holds an "
                    "interface with the dofs 123456 or 123"
                )
            found.append(self._to_ground(f"ground of {point}", side, range(len(components))))
        return found

    def _to_ground(self, name: str, side: Side, locked: Iterable[int]) -> Connection:
        x, R = self.places[side.body]
        none = np.zeros((3, 0))
        ground = Side(-1, Marker(x + R @ side.marker.position, none, none), np.eye(3))
        # The axes of the scene, seen from the frame.
        return Connection(name, ground, Side(side.body, side.marker, R), *_locks(locked))

    def _movement(self, channel: Channel) -> Movement:
        terms: list[PointMotion | JointMotion | StrutMotion] = []
        start = 0.0
        for term in channel.terms:
            if isinstance(term, PointTerm):
                number, marker = self._marker(term.at)
                axes = self.bodies[number].axes
                along = np.concatenate([axes @ term.direction[:3], axes @ term.direction[3:]])
                terms.append(PointMotion(number, marker, along))
            elif isinstance(term, JointTerm):
                number = self.by_joint[term.joint]
                terms.append(JointMotion(number, term.dof))
                joint = next(joint for joint in self.scene.joints if joint.joint.name == term.joint)
                start += self._value(joint, term.dof)
            else:
                ends = (self._marker(term.a), self._marker(term.b))
                terms.append(StrutMotion(*(Side(number, marker, np.eye(3)) for number, marker in ends)))
        return Movement(channel.name, tuple(terms), start)


def _locks(motions: Iterable[int]) -> tuple[tuple[int, ...], tuple[tuple[int, int], ...]]:
    """Translations that are locked, and pairs of axes that stay normal."""
    locked = frozenset(motions)
    return tuple(sorted(dof for dof in locked if dof < 3)), tuple(locked_rotations(frozenset(range(6)) - locked))
