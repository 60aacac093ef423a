"""The scene: configurations of joined bodies, actuators, sensors and frequency band."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, UnitsError
from cmsreduce.model.joint import DOF_NAMES, Joint, Point
from cmsreduce.model.parameters import Values
from cmsreduce.model.units import SI, Units

__all__ = [
    "Channel",
    "Configuration",
    "JointTerm",
    "Placement",
    "PointTerm",
    "Scene",
    "StrutTerm",
]


@dataclass(frozen=True, eq=False)
class PointTerm:
    """Motion of a point, or force on it, along a direction.

    Parameters
    ----------
    at : Point
        Place.
    direction : (6,) float64
        Weights of x y z rx ry rz, along the basic axes of the body, which turn with it.
    """

    at: Point
    direction: NDArray[np.float64]


@dataclass(frozen=True)
class JointTerm:
    """Motion of a joint's second interface relative to the first, or the equal and opposite efforts on them.

    Parameters
    ----------
    joint : str
        Name of the joint.
    dof : int
        0..5 along the joint's axes.
    """

    joint: str
    dof: int


@dataclass(frozen=True)
class StrutTerm:
    """Change of the distance between two points, or the pair of forces that pushes them apart."""

    a: Point
    b: Point


@dataclass(frozen=True, eq=False)
class Channel:
    """An actuator or a sensor: one input or one output.

    Parameters
    ----------
    name : str
        Unique among the inputs or the outputs.
    terms : tuple of PointTerm, JointTerm or StrutTerm
        The measured motion is their sum; an actuator's effort acts on their transpose.
    quantity : {"translation", "rotation", "combination"}
        Kind of motion, which decides the scaling of the response.
    rate : bool
        True for a sensor of the rate.
    """

    name: str
    terms: tuple[PointTerm | JointTerm | StrutTerm, ...]
    quantity: Literal["translation", "rotation", "combination"]
    rate: bool = False

    def motion_unit(self, units: Units) -> str:
        """Unit that a sensor measures in, such as ``rad/s``; empty for a combination of motions."""
        unit = {"translation": units.length_name, "rotation": "rad"}.get(self.quantity, "")
        return f"{unit}/s" if unit and self.rate else unit

    def effort_unit(self, units: Units) -> str:
        """Unit of an actuator's effort, such as ``N m``; empty for a combination of force and moment."""
        return {"translation": units.force_name, "rotation": units.moment_name}.get(self.quantity, "")


@dataclass(frozen=True)
class Configuration:
    """A configuration: one set of joint angles and parameters.

    Parameters
    ----------
    name : str
        Label, such as ``spin=45 cone=30``.
    angles : mapping of (joint, dof 0..5) to float
        In radians, or in the scene's unit of length for a translation; motions without a value are zero.
    parameters : mapping of name to float
        Values of the parameters in the scene's units; a parameter without a value is zero.
    between : bool
        It lies between those that the scene names: closed loops take the nearest angles that close them.
    """

    name: str
    angles: Mapping[tuple[str, int], float] = field(default_factory=dict)
    parameters: Values = field(default_factory=dict)
    between: bool = False

    @property
    def as_built(self) -> Configuration:
        """The configuration with all joints at zero."""
        return Configuration("as built", parameters=self.parameters)


@dataclass(frozen=True, eq=False)
class Placement:
    """Placement of a body in the scene: x_scene = rotation @ x_body + translation."""

    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    translation: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class Scene:
    """Joints, configurations, channels and frequency band of a set of bodies.

    Parameters
    ----------
    bodies : tuple of str
        Names of the bodies, in order.
    band : (float, float)
        Lowest and highest frequency of interest in Hz.
    joints : tuple of Joint
        Connections.
    configurations : tuple of Configuration
        Configurations in which the model is assembled and checked; at least one.
    actuators, sensors : tuple of Channel
        Inputs and outputs.
    base : str
        Body that articulation does not move.
    ground : tuple of Point
        Interfaces held to the ground; without one the system floats free.
    floating : tuple of str
        Bodies that are not connected to the base on purpose.
    redundant : {"refuse", "drop"}
        Treatment of motions that joints lock twice.
    placements : mapping of body to Placement
        Placements of bodies that are not in the shared basic frame.
    units : Units
        Unit system of the scene; every body is converted to it.

    Raises
    ------
    SceneError
        If a name repeats, or a body or joint does not exist.
    UnitsError
        If the unit of time is not the second: bands and cutoffs are in Hz.
    """

    bodies: tuple[str, ...]
    band: tuple[float, float]
    joints: tuple[Joint, ...] = ()
    configurations: tuple[Configuration, ...] = (Configuration("as built"),)
    actuators: tuple[Channel, ...] = ()
    sensors: tuple[Channel, ...] = ()
    base: str = ""
    ground: tuple[Point, ...] = ()
    floating: tuple[str, ...] = ()
    redundant: Literal["refuse", "drop"] = "refuse"
    placements: Mapping[str, Placement] = field(default_factory=dict)
    units: Units = SI

    def __post_init__(self) -> None:
        if not 0 <= self.band[0] < self.band[1]:
            raise SceneError(f"band {self.band[0]:g} to {self.band[1]:g} Hz is empty")
        if self.units.time != 1.0:
            raise UnitsError(
                f"the scene's units '{self.units.name}' do not count time in seconds, but its frequencies are in Hz: "
                "give the scene units in s, and the components their own `units:`, which are converted"
            )
        for what, items in (("joint", self.joints), ("actuator", self.actuators), ("sensor", self.sensors)):
            names = [item.name for item in items]
            repeated = sorted({name for name in names if names.count(name) > 1})
            if repeated:
                raise SceneError(f"two {what}s are named '{repeated[0]}'")
        joints = {joint.name: joint for joint in self.joints}
        bodies = f"(there are: {', '.join(self.bodies)})"
        for point in self.points():
            if point.body not in self.bodies:
                raise SceneError(f"'{point}': there is no component '{point.body}' {bodies}")
        named = [
            (f"'{channel.name}'", term.joint)
            for channel in (*self.actuators, *self.sensors)
            for term in channel.terms
            if isinstance(term, JointTerm)
        ]
        angles = [angle for configuration in self.configurations for angle in configuration.angles]
        for where, name in named + [("articulation", name) for name, _ in angles]:
            if name not in joints:
                raise SceneError(f"{where}: there is no joint '{name}' (there are: {', '.join(joints)})")
        for name, dof in angles:
            if dof not in joints[name].free:
                raise SceneError(
                    f"articulation: joint '{name}' is not free in {DOF_NAMES[dof]}, so it cannot be turned"
                )
        for name in self.floating:
            if name not in self.bodies:
                raise SceneError(f"floating: there is no component '{name}' {bodies}")
        if self.base and self.base not in self.bodies:
            raise SceneError(f"base '{self.base}' is no component {bodies}")

    def __repr__(self) -> str:
        counts = f"{len(self.joints)} joints, {len(self.configurations)} configurations"
        channels = f"{len(self.actuators)} actuators, {len(self.sensors)} sensors"
        return f"<Scene {', '.join(self.bodies)}: {counts}, {channels}, band to {self.band[1]:g} Hz>"

    def points(self) -> tuple[Point, ...]:
        """Every point the scene refers to, in order of first mention."""
        found: dict[Point, None] = {}
        for joint in self.joints:
            found.update({joint.first: None, joint.second: None})
        found.update(dict.fromkeys(self.ground))
        for channel in (*self.actuators, *self.sensors):
            for term in channel.terms:
                if isinstance(term, PointTerm):
                    found[term.at] = None
                elif isinstance(term, StrutTerm):
                    found.update({term.a: None, term.b: None})
        return tuple(found)
