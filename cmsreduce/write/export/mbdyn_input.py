"""MBDyn's input under construction: labels, structural nodes, elements, drives, and the bodies that they belong to."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import MultibodyScene, Point, SceneBody, SceneJoint
from cmsreduce.write.export.body_frame import BodyFrame, point_position

__all__ = ["MbdynInput", "Place", "matrix", "quoted", "real", "vector"]

_COUNTED = {"joint": "joints", "force": "forces", "couple": "forces", "body": "rigid bodies"}
"""Elements, and the card that counts them."""

Array = NDArray[np.float64]


def real(value: float) -> str:
    """A number with all its digits; zero has no sign."""
    return repr(float(value) + 0.0)


def vector(values: Array) -> str:
    """Three components."""
    return ", ".join(real(value) for value in values) if np.any(values) else "null"


def matrix(rows: Array) -> str:
    """Nine entries by rows."""
    return "eye" if np.array_equal(rows, np.eye(3)) else "matr, " + ", ".join(real(value) for value in rows.ravel())


def quoted(words: str) -> str:
    """Words in quotes."""
    return '"' + words.replace("\\", "/").replace('"', "'") + '"'


@dataclass(frozen=True, eq=False)
class Place:
    """A point that moves and turns with a node of MBDyn.

    Parameters
    ----------
    node : str
        Label of the node.
    offset : (3,) float64
        From the node, along its axes.
    position : (3,) float64
        In the basic frame of the body.
    body : SceneBody
        The body; undeformed, its nodes have the axes of its frame.
    frame : BodyFrame
        Frame of the body.
    name : str
        Of the point, for labels.
    slope : bool
        False if the slope of the node is not known, so that it carries no moment.
    """

    node: str
    offset: Array
    position: Array
    body: SceneBody
    frame: BodyFrame
    name: str
    slope: bool = True

    @property
    def in_scene(self) -> Array:
        """Position (3,) in the scene."""
        return np.asarray(self.body.placement.rotation @ self.position + self.body.placement.translation)

    @property
    def axes_in_scene(self) -> Array:
        """Axes of the node as columns (3, 3), in the scene."""
        return np.asarray(self.body.placement.rotation @ self.frame.axes.T)

    def along(self, basic: Array) -> Array:
        """Direction along the axes of the node, from one along the basic axes of the body."""
        return self.frame.along(basic)

    def oriented(self, rows: Array, order: tuple[int, int, int] = (0, 1, 2)) -> str:
        """Orientation against the node of axes that are rows in the basic frame of the body."""
        return matrix((rows @ self.frame.axes.T)[list(order)].T)

    def moved(self, arm: Array) -> Place:
        """The point at the end of a rigid arm, which is along the basic axes of the body."""
        return replace(self, offset=self.offset + self.along(arm), position=self.position + arm)

    def require_slope(self, what: str) -> None:
        """Refuse a rotation or a moment at a node of solid elements.

        Raises
        ------
        WriteError
            If the slope of the node is not known.
        """
        if not self.slope:
            raise WriteError(
                f"{what}: the slope of a node of '{self.body.name}' is not known, so that MBDyn would turn it with the "
                "whole body; tie several nodes to an interface with rotations"
            )


@dataclass(eq=False)
class MbdynInput:
    """Blocks of an input file; labels have names, so that a user can read and edit it.

    Parameters
    ----------
    scene : MultibodyScene
        The scene.
    frames : mapping of body to BodyFrame
        Frames of its bodies.
    labels : mapping of name to text
        Names of integer constants, with their meaning.
    carriers, dummies : mapping of label to text
        Nodes of bodies and of the ground, and nodes that only observe.
    elements, drives : list of str
        Cards of elements, and of the drives that write the sensors.
    counts : mapping of card to int
        Numbers of elements.
    attached : mapping of body to mapping of node to Place
        Nodes of flexible bodies at which something acts.
    heavy : set of str
        Labels of those nodes that carry an inertia of their own.
    """

    scene: MultibodyScene
    frames: dict[str, BodyFrame]
    labels: dict[str, str] = field(default_factory=dict)
    carriers: dict[str, str] = field(default_factory=dict)
    dummies: dict[str, str] = field(default_factory=dict)
    elements: list[str] = field(default_factory=list)
    drives: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    attached: dict[str, dict[int, Place]] = field(default_factory=dict)
    heavy: set[str] = field(default_factory=set)
    _names: dict[tuple[str, str], str] = field(default_factory=dict)

    def label(self, kind: str, name: str, about: str = "") -> str:
        """Name of an integer constant, the same for the same kind and name."""
        if (kind, name) not in self._names:
            plain = f"{kind}_" + re.sub(r"[^A-Za-z0-9_]", "_", name)
            found = plain
            while found in self.labels:
                found += "_"
            self.labels[found] = about or name
            self._names[kind, name] = found
        return self._names[kind, name]

    def element(self, kind: str, label: str, text: str) -> None:
        """Add an element."""
        self.elements.append(f"{kind}: {label}, {text};")
        what = _COUNTED[kind]
        self.counts[what] = self.counts.get(what, 0) + 1

    def drive(self, label: str, name: str, text: str) -> None:
        """Add a drive whose values are written to scene.drv."""
        self.drives.append(f"drive caller: {label}, name, {quoted(name)}, {text}, output, yes;")

    def joint(self, name: str) -> SceneJoint:
        """A joint of the scene."""
        return next(placed for placed in self.scene.joints if placed.joint.name == name)

    def place(self, point: Point) -> Place:
        """A point of the scene: an interface by its first node, a node, or the centre of mass of a rigid body."""
        body = self.scene.body(point.body)
        if body.rigid is None:
            return self._at_node(body, body.node(point.name))
        return self._on_rigid(body, point_position(body, point), point.name)

    def of_interface(self, point: Point, k: int = 0) -> Place:
        """A node of an interface."""
        body = self.scene.body(point.body)
        face = body.interfaces[point.name]
        if body.rigid is None:
            return self._at_node(body, int(face.node[k]))
        return self._on_rigid(body, face.position[k], point.name)

    def _on_rigid(self, body: SceneBody, position: Array, name: str) -> Place:
        frame = self.frames[body.name]
        label = self.label("body", body.name)
        return Place(label, position - frame.origin, position, body, frame, f"{body.name}_{name}")

    def _at_node(self, body: SceneBody, node: int) -> Place:
        """A node that the modal joint moves; its card follows, when all that attaches to it is known."""
        frame, known = self.frames[body.name], self.attached.setdefault(body.name, {})
        assert frame.reduced is not None
        at = np.flatnonzero(frame.reduced.node == node)
        if not at.size:
            raise WriteError(f"component '{body.name}': node {node} is not in its file")
        position = frame.origin + frame.axes.T @ frame.reduced.position[at[0]]
        name = f"{body.name}_{node}"
        label = self.label("node", name, f"node {node} of {body.name}")
        known[node] = Place(label, np.zeros(3), position, body, frame, name, node not in frame.reduced.blind)
        return known[node]

    def node_cards(self) -> list[str]:
        """Cards of all structural nodes; dummy nodes come last, because they are seen from others."""
        moved = {
            place.node: f"{'dynamic' if place.node in self.heavy else 'static'}, {vector(place.in_scene)}, "
            f"{matrix(place.axes_in_scene)}, null, null"
            for known in self.attached.values()
            for place in known.values()
        }
        cards = self.carriers | moved | self.dummies
        return [f"structural: {label}, {text};" for label, text in cards.items()]
