"""Joints: which motions of two interfaces are free, and what acts on these."""

from __future__ import annotations

from dataclasses import dataclass, replace

from cmsreduce.errors import SceneError
from cmsreduce.model.parameters import Values

__all__ = ["DOF_NAMES", "FIRST_ROTATION", "Joint", "JointElement", "Point", "dof_index"]

DOF_NAMES = ("x", "y", "z", "rx", "ry", "rz")
"""Names of the six motions of a point, in order."""

FIRST_ROTATION = 3
"""The first rotation among the six motions of a point."""


def dof_index(name: str) -> int:
    """Position 0..5 of a motion's name: ``x``, ``rx``, or a digit 1..6.

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
class JointElement:
    """Spring, damper and inertia of a joint along or about one of its free motions.

    The spring and the damper act on the motion of the second interface relative to the first. The inertia belongs to
    the joint: it turns with the first interface, and is not part of the mass properties of a body.

    Parameters
    ----------
    dof : int
        Motion 0..5 along the joint's axes.
    stiffness, damping : float
        In the scene's units: force per length or moment per radian; for the damping, times a second.
    inertia : float
        Moment of inertia about the joint's axis; rotations only.
    varied : tuple of (parameter, "stiffness" or "damping" or "inertia")
        Parameters of the scene whose values are added.

    Raises
    ------
    SceneError
        If a value is negative, or a translation has an inertia.
    """

    dof: int
    stiffness: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0
    varied: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        for what in ("stiffness", "damping", "inertia"):
            if not getattr(self, what) >= 0:
                raise SceneError(f"a joint's {what} of {getattr(self, what):g} is negative")
        if self.has("inertia") and self.dof < FIRST_ROTATION:
            raise SceneError(
                "a joint's inertia is about one of its axes; a part that slides has mass in every direction: "
                "add its mass to a body"
            )

    def has(self, what: str) -> bool:
        """True if the element has a stiffness, damping or inertia, by itself or by a parameter."""
        return bool(getattr(self, what)) or any(figure == what for _, figure in self.varied)

    def at(self, values: Values) -> JointElement:
        """The element at some values of the parameters.

        Raises
        ------
        SceneError
            If a stiffness, damping or inertia is negative.
        """
        added = dict.fromkeys(("stiffness", "damping", "inertia"), 0.0)
        for parameter, what in self.varied:
            added[what] += values.get(parameter, 0.0)
        return JointElement(self.dof, *(getattr(self, what) + more for what, more in added.items()))


@dataclass(frozen=True)
class Point:
    """A place on a body: an interface's name, a node id in digits, or ``cg`` of a rigid body."""

    body: str
    name: str

    def __str__(self) -> str:
        return f"{self.body}.{self.name}"


@dataclass(frozen=True)
class Joint:
    """A connection of two interfaces.

    Parameters
    ----------
    name : str
        Name of the joint.
    first, second : Point
        Interfaces; the first one gives the axes.
    free : frozenset of int
        Motions 0..5 along the axes that are free; the others are locked.
    offset : tuple of 3 float, optional
        Rigid arm from the first interface to the second in the first body's basic frame, if they do not coincide.
    elements : tuple of JointElement
        Springs, dampers and inertias, at most one element for each motion.

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
            if dof not in self.free and (element.has("stiffness") or element.has("damping")):
                raise SceneError(
                    f"joint '{self.name}': {DOF_NAMES[dof]} is locked, so that no spring or damper acts on it: "
                    f"free it (`free: [{DOF_NAMES[dof]}]`), or take the key out"
                )
            if acted_on.count(dof) > 1:
                raise SceneError(f"joint '{self.name}': two elements act on {DOF_NAMES[dof]}; add their values")

    def locked(self) -> Joint:
        """The same joint with its free motions locked; its inertias stay."""
        held = (
            JointElement(
                element.dof, inertia=element.inertia, varied=tuple(one for one in element.varied if one[1] == "inertia")
            )
            for element in self.elements
        )
        return replace(self, free=frozenset(), elements=tuple(each for each in held if each.has("inertia")))

    def at(self, values: Values) -> Joint:
        """The joint at some values of the parameters, which no longer vary."""
        return replace(self, elements=tuple(element.at(values) for element in self.elements))

    @property
    def own_body(self) -> str:
        """Name of the body of the joint's elements; the blank in it keeps it apart from the names of components."""
        return f"joint {self.name}"
