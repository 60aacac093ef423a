"""What acts in a joint on one of its free motions.

The scene the bodies act in: joints, configurations, actuators, sensors, band.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, UnitsError
from cmsreduce.model.units import SI, Units

__all__ = [
    "Channel",
    "Configuration",
    "DOF_NAMES",
    "Joint",
    "JointElement",
    "JointTerm",
    "Placement",
    "Point",
    "PointTerm",
    "Scene",
    "StrutTerm",
    "dof_index",
]

_FIRST_ROTATION = 3


@dataclass(frozen=True)
class JointElement:
    """Spring, damper and inertia of a joint along or about one of its free motions.

    The spring and the damper act on the motion of the second interface against the first. The inertia belongs to the
    joint, not to a body: it turns with the first interface, and no mass properties of a body contain it.

    Parameters
    ----------
    dof : int
        Motion 0..5 along the joint's axes.
    stiffness, damping : float
        In the scene's units: force a length, or moment a radian; the same times a second.
    inertia : float
        Moment of inertia about the joint's axis, of a rotation only.

    Raises
    ------
    SceneError
        If a figure is negative, or a translation is given an inertia.
    """

    dof: int
    stiffness: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0

    def __post_init__(self) -> None:
        for what in ("stiffness", "damping", "inertia"):
            if not getattr(self, what) >= 0:
                raise SceneError(f"a joint's {what} of {getattr(self, what):g} is negative")
        if self.inertia and self.dof < _FIRST_ROTATION:
            raise SceneError(
                "a joint's inertia turns about one of its axes; what slides along an axis has mass in every direction: "
                "give it to a body"
            )


DOF_NAMES = ("x", "y", "z", "rx", "ry", "rz")
"""Names of the six motions of a point, in order."""


def dof_index(name: str) -> int:
    """Position 0..5 of a motion's name; ``x``, ``rx``, or a digit 1..6.

    Raises
    ------
    SceneError
        If the name is none of these.
    """
    text = str(name).strip().lower()
    if text in DOF_NAMES:
        return DOF_NAMES.index(text)
    if text in {"tx", "ty", "tz"}:
        return "xyz".index(text[1])
    if text in set("123456"):
        return int(text) - 1
    raise SceneError(f"'{name}' is no dof: use {', '.join(DOF_NAMES)}")


@dataclass(frozen=True)
class Point:
    """A place on a body: an interface's name, a node id in digits, or ``cg`` of a rigid body."""

    body: str
    name: str

    def __str__(self) -> str:
        return f"{self.body}.{self.name}"


@dataclass(frozen=True, eq=False)
class PointTerm:
    """Motion of (or force on) a point along a direction.

    Parameters
    ----------
    at : Point
        Where.
    direction : (6,) float64
        Weights of x y z rx ry rz, along the basic axes of the body, which turn with it.
    """

    at: Point
    direction: NDArray[np.float64]


@dataclass(frozen=True)
class JointTerm:
    """Relative motion in a joint, or the equal and opposite effort: second interface against the first.

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
    """Change of distance between two points, or the pair of forces that pushes them apart."""

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
        Their sum is the measured motion; an actuator's effort acts on their transpose.
    quantity : {"translation", "rotation", "combination"}
        What it acts on or measures; decides the unit its response is scaled in.
    rate : bool
        Whether a sensor measures the rate.
    """

    name: str
    terms: tuple[PointTerm | JointTerm | StrutTerm, ...]
    quantity: Literal["translation", "rotation", "combination"]
    rate: bool = False


@dataclass(frozen=True)
class Joint:
    """A connection of two interfaces.

    Parameters
    ----------
    name : str
        Name of the joint.
    first, second : Point
        Interfaces; the axes are those of the first.
    free : frozenset of int
        Motions 0..5 along the axes that are free; the others are locked.
    offset : tuple of 3 float, optional
        Rigid arm from the first interface to the second in the first body's basic frame, where they do not coincide.
    elements : tuple of JointElement
        Springs, dampers and inertias on free motions, one for each motion at most.

    Raises
    ------
    SceneError
        If a spring or a damper acts on a locked motion, or two elements on the same one.
    """

    name: str
    first: Point
    second: Point
    free: frozenset[int] = frozenset()
    offset: tuple[float, float, float] | None = None
    elements: tuple[JointElement, ...] = ()

    def __post_init__(self) -> None:
        acted_on = [element.dof for element in self.elements]
        for element in self.elements:
            dof = element.dof
            if dof not in self.free and (element.stiffness or element.damping):
                raise SceneError(
                    f"joint '{self.name}': {DOF_NAMES[dof]} is locked, so that no spring or damper acts on it: "
                    f"free it (`free: [{DOF_NAMES[dof]}]`), or take the key out"
                )
            if acted_on.count(dof) > 1:
                raise SceneError(f"joint '{self.name}': two elements act on {DOF_NAMES[dof]}; add their figures up")

    def locked(self) -> Joint:
        """The same joint with its free motions held; its inertias turn with it."""
        held = (JointElement(element.dof, inertia=element.inertia) for element in self.elements)
        return replace(self, free=frozenset(), elements=tuple(element for element in held if element.inertia))

    @property
    def own_body(self) -> str:
        """Name of the body that holds the joint's elements; no component can have it, since it holds a blank."""
        return f"joint {self.name}"


@dataclass(frozen=True)
class Configuration:
    """A setting of the articulated joints.

    Parameters
    ----------
    name : str
        Label, such as ``spin=45 cone=30``.
    angles : mapping of (joint, dof 0..5) to float
        Radians, or the scene's unit of length for a translation; all others are zero.
    """

    name: str
    angles: Mapping[tuple[str, int], float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a body stands in the scene: x_scene = rotation @ x_body + translation."""

    rotation: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    translation: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True, eq=False)
class Scene:
    """What the bodies are for.

    Parameters
    ----------
    bodies : tuple of str
        Names of the bodies, in order.
    band : (float, float)
        Lowest and highest frequency of interest in Hz.
    joints : tuple of Joint
        Connections.
    configurations : tuple of Configuration
        Settings at which the model is assembled and checked; at least one.
    actuators, sensors : tuple of Channel
        Inputs and outputs.
    base : str
        Body that articulation does not move.
    ground : tuple of Point
        Interfaces held to the ground; without one the system floats free.
    floating : tuple of str
        Bodies that no chain of joints leads to, on purpose.
    redundant : {"refuse", "drop"}
        What to do with motions that joints lock twice.
    placements : mapping of body to Placement
        Bodies moved from the shared basic frame.
    units : Units
        Unit system of the scene; every body is converted to it.

    Raises
    ------
    SceneError
        If names repeat or point to bodies and joints that are not there.
    UnitsError
        If its unit of time is not the second: bands and cutoffs are in Hz.
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
        for point in self.points():
            if point.body not in self.bodies:
                raise SceneError(
                    f"'{point}': there is no component '{point.body}' (there are: {', '.join(self.bodies)})"
                )
        for channel in (*self.actuators, *self.sensors):
            for term in channel.terms:
                if isinstance(term, JointTerm) and term.joint not in joints:
                    raise SceneError(
                        f"'{channel.name}': there is no joint '{term.joint}' (there are: {', '.join(joints)})"
                    )
        for configuration in self.configurations:
            for name, dof in configuration.angles:
                if name not in joints:
                    raise SceneError(f"articulation: there is no joint '{name}' (there are: {', '.join(joints)})")
                if dof not in joints[name].free:
                    raise SceneError(
                        f"articulation: joint '{name}' is not free in {DOF_NAMES[dof]}, so it cannot be turned"
                    )
        for name in self.floating:
            if name not in self.bodies:
                raise SceneError(f"floating: there is no component '{name}' (there are: {', '.join(self.bodies)})")
        if self.base and self.base not in self.bodies:
            raise SceneError(f"base '{self.base}' is no component (there are: {', '.join(self.bodies)})")

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
