"""Keys of an interface, of its frame, and of rotations about axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema, model_validator

from cmsreduce.config.keys.mapping import (
    DofNames,
    Keys,
    Length,
    LengthVector,
    Name,
    OneOrMore,
    Plain,
    Positive,
    Vector,
    exactly_one,
    reported,
)
from cmsreduce.config.keys.quantities import measure
from cmsreduce.model import cross_matrix, dof_index

__all__ = [
    "Angle",
    "Axis",
    "FrameKeys",
    "InterfaceKeys",
    "InterfaceName",
    "Rotation",
    "Rotations",
    "rotation_matrix",
]

# Axes typed by hand have at least four digits. A larger deviation is an error of the user.
_SQUARE = 1e-3

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _parse_axis(value: object) -> object:
    if isinstance(value, str):
        if value.lower() not in _AXES:
            raise ValueError(f"'{value}' is no axis: write x, y, z or a vector such as [0, 1, 1]")
        return _AXES[value.lower()]
    if isinstance(value, (list, tuple)) and all(isinstance(v, (int, float)) and v == 0 for v in value):
        raise ValueError("an axis of length zero has no direction")
    return value


Angle = Annotated[
    float,
    BeforeValidator(reported(lambda value: measure(value, "angle"))),
    PlainSerializer(lambda angle: f"{angle!r} rad"),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"const": 0}]}),
]
"""Angle in radians; written with its unit."""

Axis = Annotated[
    Vector,
    BeforeValidator(_parse_axis),
    WithJsonSchema(
        {"anyOf": [{"enum": ["x", "y", "z"]}, {"type": "array", "items": {"type": "number"}, "minItems": 3}]}
    ),
]
"""Axis by its letter or as a vector that is not zero."""


class Rotation(Keys):
    """One turn about an axis."""

    axis: Axis = Field(description="Axis: x, y, z or three numbers of any length.", examples=["z"])
    angle: Angle = Field(description="Right-handed angle with its unit.", examples=["30 deg"])


Rotations = Annotated[tuple[Rotation, ...], Field(min_length=1), OneOrMore()]
"""One rotation or a list of rotations, in order, about fixed axes."""


def rotation_matrix(rotations: Sequence[Rotation]) -> NDArray[np.float64]:
    """Matrix of several rotations, the first one first, about fixed axes (3, 3), by Rodrigues' formula."""
    R: NDArray[np.float64] = np.eye(3)
    for turn in rotations:
        W: NDArray[Any] = cross_matrix(np.asarray(turn.axis) / np.linalg.norm(turn.axis))
        R = (np.eye(3) + np.sin(turn.angle) * W + (1 - np.cos(turn.angle)) * W @ W) @ R
    return R


NodeId = Annotated[int, Strict(), Field(gt=0)]


def _check_interface_name(name: str) -> str:
    if name.isdigit() or name == "cg":
        taken = "a node" if name.isdigit() else "the centre of mass of a rigid body"
        raise ValueError(f"an interface cannot be named '{name}': that name stands for {taken}")
    return name


InterfaceName = Annotated[Name, AfterValidator(_check_interface_name)]
"""Name that is not a node number and not ``cg``."""


def _distinct(nodes: tuple[int, ...]) -> tuple[int, ...]:
    repeated = [node for k, node in enumerate(nodes) if node in nodes[:k]]
    if repeated:
        raise ValueError(f"node {repeated[0]} is named twice")
    return nodes


def _check_axes(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 3:
        raise ValueError(f"3 axes of 3 numbers are expected, found {len(value)}")
    return value


class FrameKeys(Keys):
    """Axes of an interface in the body's basic frame: rotated from it, or as three vectors."""

    alternatives: ClassVar[tuple[str, ...]] = ("axes", "rotate")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = (
        {"const": "basic"},
        {"type": "object", "required": ["axis", "angle"], "maxProperties": 2, "description": "One rotation."},
    )

    axes: Annotated[tuple[Vector, Vector, Vector], BeforeValidator(_check_axes)] | None = Field(
        default=None,
        description="Axes x, y, z of the frame as three orthonormal, right-handed vectors.",
        examples=[[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]],
    )
    rotate: Rotations | None = Field(
        default=None,
        description="Rotations that turn the basic axes into those of the frame, about the basic axes, in order.",
        examples=[{"axis": "z", "angle": "90 deg"}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read ``basic``, or a lone rotation."""
        if value == "basic":
            return {"axes": np.eye(3).tolist()}
        if isinstance(value, str):
            raise ValueError(f"'{value}' is no frame: write basic, {{axes: ...}} or {{rotate: ...}}")
        if isinstance(value, dict) and value.keys() <= {"axis", "angle"}:
            return {"rotate": value}
        return value

    @model_validator(mode="after")
    def _orthonormal(self) -> FrameKeys:
        if exactly_one(self, ("axes", "rotate"), "frame") == "axes":
            A = np.asarray(self.axes)
            off = float(np.abs(A @ A.T - np.eye(3)).max())
            if off > _SQUARE:
                raise ValueError(f"the axes are not orthonormal: A A^T differs from the identity by {off:.2g}")
            if np.linalg.det(A) < 0:
                raise ValueError("the axes are left-handed: change the sign of one")
        return self

    def rows(self) -> NDArray[np.float64]:
        """(3, 3) axes as rows, in basic components, orthonormal to round-off."""
        if self.rotate is not None:
            return rotation_matrix(self.rotate).T
        U, _, Vt = np.linalg.svd(np.asarray(self.axes, dtype=np.float64))
        return np.asarray(U @ Vt)


class InterfaceKeys(Keys):
    """Place of a body at which a joint can attach; a lone number is a node."""

    # A position stands beside the nodes of a tie.
    alternatives: ClassVar[tuple[str, ...]] = ("node", "nodes", "set", "near")
    short_key: ClassVar[str] = "node"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "integer"},)

    node: NodeId | None = Field(default=None, description="Node id.", examples=[1001])
    nodes: Annotated[tuple[NodeId, ...], Field(min_length=1), AfterValidator(_distinct)] | None = Field(
        default=None, description="Several node ids; a joint pairs them in this order.", examples=[[7, 8, 9]]
    )
    set: Plain | None = Field(
        default=None,
        description="Dof set of the source, such as b, or a set of nodes that the geometry names (*NSET, physical "
        "group, point set).",
        examples=["b"],
    )
    position: LengthVector | None = Field(
        default=None,
        description="Point of a rigid body, or point to which nodes are tied (by default their centroid), in the "
        "body's basic frame and unit of length, or with units.",
        examples=[[0, 0, 0]],
    )
    near: LengthVector | None = Field(
        default=None,
        description="Place of the nodes, in the body's basic frame and unit of length, or with units.",
        examples=[[0, 0, "120 mm"]],
    )
    within: Length | None = Field(
        default=None, description="Distance from `near` up to which nodes belong to the interface.", examples=["2 mm"]
    )
    match: Literal["all", "nearest"] = Field(
        default="all", description="Takes all nodes within the distance, or the nearest alone."
    )
    dofs: DofNames | None = Field(
        default=None,
        min_length=1,
        description="Dofs of the interface, or dofs that a rigid tie moves; by default those of 123456 that the node "
        "or set has.",
        examples=[123],
    )
    frame: FrameKeys | None = Field(
        default=None,
        description="Axes of joints on this interface; by default those of its first node, basic ones for a tie.",
        examples=[{"axis": "z", "angle": "30 deg"}],
    )
    tie: Literal["rigid", "average"] | None = Field(
        default=None,
        description="Ties the nodes or the set to one point with dofs 123456, which is then the interface. rigid: the "
        "nodes move with the point as one rigid piece (RBE2); average: the point follows the mean motion of the nodes "
        "and adds no stiffness (RBE3).",
    )
    weights: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Weight of each node in an average tie; by default all are equal.",
        examples=[[1.0, 2.0, 1.0]],
    )

    @model_validator(mode="after")
    def _one_place(self) -> InterfaceKeys:
        if self.near is not None and (self.within is None or self.within.value <= 0):
            raise ValueError("`near` needs the distance within which nodes count, above zero: add `within: 2 mm`")
        if self.near is None and (self.within is not None or self.match != "all"):
            raise ValueError("`within` and `match` belong to a position: add `near: [x, y, z]`, or take them out")
        if self.tie is None:
            exactly_one(self, ("node", "nodes", "set", "position", "near"), "an interface")
            if self.weights is not None:
                raise ValueError("only an average tie has weights: add `tie: average`, or take `weights` out")
            return self
        exactly_one(self, ("node", "nodes", "set", "near"), f"`tie: {self.tie}`")
        if self.tie == "rigid" and self.weights is not None:
            raise ValueError("a rigid tie has no weights: take them out, or use `tie: average`")
        if self.tie == "average" and self.dofs is not None:
            raise ValueError("an average tie uses the translations of the nodes: take `dofs` out, or use `tie: rigid`")
        if self.weights is not None and self.nodes is None:
            raise ValueError("weights belong to a list of nodes: name them by `nodes: [...]`, or take `weights` out")
        if self.weights is not None and self.nodes is not None and len(self.weights) != len(self.nodes):
            raise ValueError(f"{len(self.nodes)} nodes need as many weights, found {len(self.weights)}")
        return self

    @property
    def components(self) -> tuple[int, ...]:
        """Component numbers 1..6 of the interface, as far as the body has them."""
        return tuple(range(1, 7)) if self.dofs is None else tuple(dof_index(name) + 1 for name in self.dofs)
