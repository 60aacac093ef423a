"""Keys of momentum wheels, which turn in a body at constant speed."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema

from cmsreduce.config.keys.interface import Axis, InterfaceName
from cmsreduce.config.keys.mapping import Keys, reported
from cmsreduce.config.keys.quantities import Compound, figure_powers, parse_compound, powers_of
from cmsreduce.model import Units

__all__ = ["MOMENTUM", "WheelKeys"]

MOMENTUM = figure_powers("damping", True)
"""Exponents of length, mass and time of an angular momentum: those of a damping about an axis."""


def _check_momentum(value: Compound) -> Compound:
    if value.unit and powers_of(value) != MOMENTUM:
        raise ValueError(f"{value} is no angular momentum, e.g. 12 N*m*s")
    return value


class WheelKeys(Keys):
    """A wheel or rotor that turns in a body at constant speed about an axis of it; its mass is in the body's."""

    at: Annotated[int, Strict(), Field(gt=0)] | InterfaceName | None = Field(
        default=None,
        description="Node with rotations, or interface of one node, that holds the wheel; a rigid body needs none.",
        examples=[1001, "rotor_mount"],
    )
    axis: Axis = Field(
        description="Axis along which the momentum points, in the body's basic frame; it stays in the body.",
        examples=["z"],
    )
    momentum: Annotated[
        Compound,
        BeforeValidator(reported(parse_compound)),
        AfterValidator(_check_momentum),
        PlainSerializer(lambda figure: figure.plain),
        WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
    ] = Field(
        default=Compound(0.0),
        description="Angular momentum of the wheel in the body, in the scene's units or with its own; a parameter "
        "may add to it.",
        examples=["12 N*m*s"],
    )

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit vector of the axis (3,)."""
        axis = np.asarray(self.axis, dtype=np.float64)
        return np.asarray(axis / np.linalg.norm(axis))

    def vector(self, units: Units) -> NDArray[np.float64]:
        """Angular momentum (3,) in the body's basic frame and a unit system."""
        return np.asarray(self.momentum.number_in(units) * self.direction)
