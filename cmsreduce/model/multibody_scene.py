"""A scene of reduced bodies in one configuration, as programs need it that integrate its motion in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, not_among
from cmsreduce.model.body import Interface
from cmsreduce.model.joint import FIRST_ROTATION, Joint, Point
from cmsreduce.model.rigid_body import RigidBody
from cmsreduce.model.scene import Channel, Configuration, Placement, Scene

__all__ = ["MultibodyScene", "SceneBody", "SceneJoint"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SceneBody:
    """A body of a scene: its data, and its place.

    Parameters
    ----------
    name : str
        Name of the body.
    interfaces : mapping of name to Interface
        Places at which joints attach, in the body's basic frame.
    placement : Placement
        Basic frame of the body in the scene, in the configuration.
    file : Path, optional
        Component file; bodies that are equal, such as copies of one component, share it. None for a rigid body.
    rigid : RigidBody, optional
        Mass, centre of mass and inertia. None for a flexible body.
    grounded : bool
        True if the matrices of the body hold it to the ground.
    """

    name: str
    interfaces: Mapping[str, Interface]
    placement: Placement
    file: Path | None = None
    rigid: RigidBody | None = None
    grounded: bool = False

    def node(self, point: str) -> int:
        """Id of the node that a point of a flexible body names: a node in digits, or the first one of an interface."""
        return int(self.interfaces[point].node[0]) if point in self.interfaces else int(point)


@dataclass(frozen=True, eq=False)
class SceneJoint:
    """A joint of a scene, with its geometry on both bodies.

    Parameters
    ----------
    joint : Joint
        Name, interfaces, free motions, rigid arm between the interfaces, springs, dampers and inertias.
    first_axes : (3, 3) float64
        Axes of the joint as rows, in the basic frame of the first body.
    second_axes : (3, 3) float64
        Axes of its rotations in the configuration, as rows, in the basic frame of the second body. They have the
        directions of the first interface's; but of two free rotations, the earlier one turns about an axis that the
        second body carries, and the locked axis is normal to both.
    values : (6,) float64
        Values of its motions x y z rx ry rz in the configuration, in the scene's unit of length and radians. They move
        the outboard body in this order, each along an axis of the first interface as it lies then; so they move the
        second interface against the first one, or the other way round. Of a joint that closes a loop, those of the
        second interface against the first one that follow from the other joints.
    locked : tuple of (tuple of int)
        Motions 0..5 along the axes that the joint locks, for each pair of nodes: those that the interfaces have.
    arms : (p, 3) float64
        Rigid arms from the first interface's nodes to the second's in the configuration, in the basic frame of the
        first body: offset and slide.
    outboard : str
        Body that the joint carries, away from the base; empty for a joint that closes a loop.
    """

    joint: Joint
    first_axes: Array
    second_axes: Array
    values: Array
    locked: tuple[tuple[int, ...], ...]
    arms: Array
    outboard: str

    @property
    def closes_loop(self) -> bool:
        """True if other joints already lead to both of its bodies."""
        return not self.outboard

    @property
    def cross(self) -> tuple[int, int] | None:
        """Axes 0..2 of two free rotations, the earlier one first, as of a universal joint; None for other joints."""
        turning = sorted(dof - FIRST_ROTATION for dof in self.joint.free if dof >= FIRST_ROTATION)
        return (turning[0], turning[1]) if len(turning) == 2 else None


@dataclass(frozen=True, eq=False)
class MultibodyScene:
    """A scene of reduced bodies in one configuration.

    Parameters
    ----------
    name : str
        Name of the pipeline.
    scene : Scene
        Configurations, actuators, sensors, base, ground, units.
    configuration : Configuration
        The configuration in which bodies and joints are placed here.
    bodies : tuple of SceneBody
        In the order of the pipeline.
    joints : tuple of SceneJoint
        In the order of the pipeline.
    """

    name: str
    scene: Scene
    configuration: Configuration
    bodies: tuple[SceneBody, ...]
    joints: tuple[SceneJoint, ...]

    @property
    def ground(self) -> tuple[Point, ...]:
        """Interfaces of which every dof is held to the ground."""
        return self.scene.ground

    @property
    def actuators(self) -> tuple[Channel, ...]:
        """Inputs; directions of their points are along the basic axes of the body, which turn with it."""
        return self.scene.actuators

    @property
    def sensors(self) -> tuple[Channel, ...]:
        """Outputs, one for each measured motion."""
        return self.scene.sensors

    def body(self, name: str) -> SceneBody:
        """The body of a name.

        Raises
        ------
        SceneError
            If there is none.
        """
        for body in self.bodies:
            if body.name == name:
                return body
        raise SceneError(not_among("body", name, [body.name for body in self.bodies]))

    def in_scene(self, body: str, position: Array) -> Array:
        """Position (..., 3) in the scene of points in the basic frame of a body."""
        place = self.body(body).placement
        return np.asarray(position @ place.rotation.T + place.translation)
