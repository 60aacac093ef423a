"""Bodies and joints as 42 (NASA) has them: a tree of parts and hinges."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import MultibodyScene, Point
from cmsreduce.write.component import ComponentFile, FlexibleBody

__all__ = ["Hinge", "Part", "Spacecraft", "euler"]

Array = NDArray[np.float64]


@dataclass(eq=False)
class Part:
    """A body of 42: rigid, flexible about mean axes, or a hub.

    Parameters
    ----------
    name : str
        Name of the body of the scene, or of the body and the node that a hub is welded to.
    origin : (3,) float64
        Origin of its frame in the scene: the centre of mass, or the node.
    axes : (3, 3) float64
        Axes of its frame as rows, in the scene.
    mass : float
        Mass; 0 for a hub.
    inertia : (3, 3) float64
        About the origin, along the axes; a hub has the inertias of the joint on it.
    file : ComponentFile, optional
        A flexible body in mean axes and with unit modal mass.
    modes : FlexibleBody, optional
        Its modes.
    joints : dict of node to int
        Numbers of the welds of its hubs.
    nodes : list of (position, comment)
        Places of thrusters.
    """

    name: str
    origin: Array
    axes: Array
    mass: float = 0.0
    inertia: Array = field(default_factory=lambda: np.zeros((3, 3)))
    file: ComponentFile | None = None
    modes: FlexibleBody | None = None
    joints: dict[str, int] = field(default_factory=dict)
    nodes: list[tuple[Array, str]] = field(default_factory=list)

    def local(self, in_scene: Array) -> Array:
        """A place in the scene, in the frame of the part (3,)."""
        return np.asarray(self.axes @ (in_scene - self.origin))


@dataclass(frozen=True, eq=False)
class Hinge:
    """A joint of 42.

    Parameters
    ----------
    name : str
        Name of the joint of the scene, or of the weld.
    inner, outer : int
        Numbers of its parts; the inner one is smaller.
    inner_axes, outer_axes : (3, 3) float64
        Axes of the joint as rows, in the frames of the parts.
    inner_place, outer_place : (3,) float64
        Where it sits, in the frames of the parts.
    turns, slides : tuple of int
        Axes 0..2 about and along which it moves, in the order of 42.
    angles, places : tuple of float
        Its motions at the start, in radians and units of length.
    rotation_spring, rotation_damper, slide_spring, slide_damper : tuple of float
        Coefficients in the order of the motions.
    sign : int
        -1 where the motion of the scene's joint is the negative of this one's.
    """

    name: str
    inner: int
    outer: int
    inner_axes: Array
    outer_axes: Array
    inner_place: Array
    outer_place: Array
    turns: tuple[int, ...] = ()
    slides: tuple[int, ...] = ()
    angles: tuple[float, ...] = ()
    places: tuple[float, ...] = ()
    rotation_spring: tuple[float, ...] = ()
    rotation_damper: tuple[float, ...] = ()
    slide_spring: tuple[float, ...] = ()
    slide_damper: tuple[float, ...] = ()
    sign: int = 1

    @property
    def has_elements(self) -> bool:
        """True if a spring or a damper acts in it."""
        return any(
            any(row) for row in (self.rotation_spring, self.rotation_damper, self.slide_spring, self.slide_damper)
        )


@dataclass(eq=False)
class Spacecraft:
    """Parts and hinges in the order of 42, and where the points of the scene are on them.

    Parameters
    ----------
    scene : MultibodyScene
        The scene.
    parts : list of Part
        Part 0 is rigid, or a hub.
    hinges : list of Hinge
        Inner parts come before outer ones.
    bodies : dict of body to int
        Number of the part that is a body of the scene.
    hubs : dict of (body, node) to int
        Number of the hub at a node of a flexible body.
    """

    scene: MultibodyScene
    parts: list[Part] = field(default_factory=list)
    hinges: list[Hinge] = field(default_factory=list)
    bodies: dict[str, int] = field(default_factory=dict)
    hubs: dict[tuple[str, int], int] = field(default_factory=dict)

    @property
    def modes(self) -> int:
        """Number of modes of all parts."""
        return sum(part.modes.k for part in self.parts if part.modes is not None)

    def place(self, point: Point) -> tuple[int, Array]:
        """Number of the part that carries a point, and its place in the scene (3,)."""
        body = self.scene.body(point.body)
        if body.rigid is not None:
            at = body.rigid.cg if point.name == "cg" else body.interfaces[point.name].position[0]
            return self.bodies[body.name], self.scene.in_scene(body.name, at)
        number = self.hubs[body.name, body.node(point.name)]
        return number, self.parts[number].origin

    def hinge_of(self, joint: str) -> tuple[int, Hinge]:
        """Number of a joint of the scene among the hinges, and the hinge."""
        return next((k, hinge) for k, hinge in enumerate(self.hinges) if hinge.name == joint)

    def add(self, part: Part) -> int:
        """Append a part; return its number."""
        self.parts.append(part)
        return len(self.parts) - 1


def euler(axes: Array) -> tuple[float, float, float]:
    """Angles in degrees about z, y, x that turn a frame to axes that are rows in it; the sequence 321 of 42."""
    z = np.arctan2(axes[0, 1], axes[0, 0])
    y = np.arctan2(-axes[0, 2], np.hypot(axes[0, 0], axes[0, 1]))
    # Also right where y is 90 degrees.
    s, c = np.sin(z), np.cos(z)
    x = np.arctan2(s * axes[2, 0] - c * axes[2, 1], c * axes[1, 1] - s * axes[1, 0])
    return tuple(np.rad2deg([z, y, x]).tolist())
