"""Rotations as the pipeline file writes them: an axis and an angle, one after another."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema

from cmsreduce.config.keys import Keys, OneOrMore, Vector, reported
from cmsreduce.config.quantities import measure
from cmsreduce.model.nodes import cross_matrix

__all__ = ["Angle", "Rotation", "Rotations", "rotation_matrix"]

_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _parse_axis(value: object) -> object:
    if isinstance(value, str):
        if value.lower() not in _AXES:
            raise ValueError(f"'{value}' is no axis: write x, y, z or three numbers")
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


class Rotation(Keys):
    """One turn about an axis."""

    axis: Annotated[
        Vector,
        BeforeValidator(_parse_axis),
        WithJsonSchema(
            {"anyOf": [{"enum": ["x", "y", "z"]}, {"type": "array", "items": {"type": "number"}, "minItems": 3}]}
        ),
    ] = Field(description="Axis: x, y, z or three numbers of any length.", examples=["z"])
    angle: Angle = Field(description="Right-handed angle with its unit.", examples=["30 deg"])


Rotations = Annotated[
    tuple[Rotation, ...],
    Field(min_length=1),
    OneOrMore(),
]
"""One rotation or a list of them, carried out in order about fixed axes."""


def rotation_matrix(rotations: Sequence[Rotation]) -> NDArray[np.float64]:
    """Matrix that turns vectors by all rotations, the first one first, about axes that stay.

    Parameters
    ----------
    rotations : sequence of Rotation
        Turns in order.

    Returns
    -------
    (3, 3) float64
        Rodrigues' formula, multiplied up.
    """
    R: NDArray[np.float64] = np.eye(3)
    for turn in rotations:
        W: NDArray[Any] = cross_matrix(np.asarray(turn.axis) / np.linalg.norm(turn.axis))
        R = (np.eye(3) + np.sin(turn.angle) * W + (1 - np.cos(turn.angle)) * W @ W) @ R
    return R
