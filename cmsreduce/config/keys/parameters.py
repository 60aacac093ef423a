"""Keys of parameters beside the joint angles: what they add to matrices of bodies and to joints."""

from __future__ import annotations

import math
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema, model_validator

from cmsreduce.config.keys.files import MatrixFile
from cmsreduce.config.keys.mapping import Keys, Name, OneOrMore, reported
from cmsreduce.config.keys.quantities import (
    Compound,
    ElementFigure,
    measure,
    parse_compound,
    parse_quantity,
    powers_of,
)
from cmsreduce.errors import UnitsError
from cmsreduce.model import Letter

__all__ = ["ParameterKeys", "ParameterMatrix", "parse_value"]


def parse_value(value: object) -> Compound:
    """Read a number with any units; frequencies and rates of rotation become rad/s."""
    try:
        return parse_compound(value)
    except UnitsError:
        quantity = parse_quantity(value)
        if quantity.dimension != "frequency":
            raise
        return Compound(2 * math.pi * measure(value, "frequency"), "rad/s")


_Value = Annotated[
    Compound,
    BeforeValidator(reported(parse_value)),
    PlainSerializer(lambda figure: figure.plain),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]


def _of_one_dimension(values: tuple[Compound, ...]) -> tuple[Compound, ...]:
    units = {value.unit for value in values if value.unit}
    if len(units) == 1:
        # As of joints: the one unit that is written holds for all.
        values = tuple(Compound(value.value, next(iter(units))) for value in values)
    dimensions = {powers_of(value) for value in values if value.value or value.unit}
    if len(dimensions) > 1:
        raise ValueError(f"{', '.join(map(str, values))}: all values of a parameter need the same unit")
    if len(set(values)) < len(values):
        raise ValueError(f"{', '.join(map(str, values))}: a value is listed twice")
    return values


class ParameterMatrix(MatrixFile):
    """A matrix that a parameter adds to one of a body, in the rows and units of the body's own files."""

    power: Annotated[int, Strict(), Field(ge=1, le=4)] = Field(
        default=1,
        description="Power of the parameter by which the matrix is multiplied: 1, or 2 for the stress of a spin.",
        examples=[2],
    )
    whole: bool = Field(
        default=False,
        strict=True,
        description="The file holds the whole matrix of the body with the parameter at `unit`, as a preloaded step "
        "writes it; that of the body is taken off.",
        examples=[True],
    )


class ParameterKeys(Keys):
    """A number that changes bodies or joints: K = K0 + sum of p^power K_p, and M, D and G alike."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ()

    values: Annotated[tuple[_Value, ...], AfterValidator(_of_one_dimension)] = Field(
        default=(),
        description="Values; the unit of one of them holds for all that have none. Each combination with those of "
        "other parameters and with the angles is a configuration; without this key a list of configurations "
        "(`articulation`) states the values.",
        examples=[[0, "50 kN"]],
    )
    unit: _Value = Field(
        default=Compound(1.0),
        description="Value of the parameter that the matrices are for; by default 1 in the scene's units.",
        examples=["1 kN"],
    )
    stiffness: dict[Name, ParameterMatrix] = Field(
        default={},
        description="Matrix that is added to the stiffness of each component named.",
        examples=[{"rotor": {"file": "K1.op4", "matrix": "KG"}}],
    )
    mass: dict[Name, ParameterMatrix] = Field(
        default={}, description="The same for the mass.", examples=[{"panel": {"file": "tuned.op4"}}]
    )
    damping: dict[Name, ParameterMatrix] = Field(
        default={},
        description="The same for the viscous damping; a damping law of a body stays that of its own K and M.",
        examples=[{"panel": {"file": "damper.op4"}}],
    )
    gyroscopic: dict[Name, ParameterMatrix] = Field(
        default={},
        description="The same for the gyroscopic matrix, which is skew and belongs to a spin.",
        examples=[{"rotor": {"file": "gyroscopic.op4"}}],
    )
    wheels: Annotated[tuple[str, ...], OneOrMore()] = Field(
        default=(),
        description="Wheels COMPONENT.WHEEL to whose angular momentum the value is added.",
        examples=["hub.roll"],
    )
    joints: dict[str, ElementFigure] = Field(
        default={},
        description="Free motions JOINT or JOINT.DOF to whose spring (`stiffness`), damper (`damping`) or `inertia` "
        "the value is added.",
        examples=[{"hinge.rz": "stiffness"}],
    )
    grounded: bool = Field(
        default=False,
        strict=True,
        description="The stiffness or damping holds bodies to the ground, so that it resists rigid motion.",
        examples=[True],
    )

    @model_validator(mode="after")
    def _acts(self) -> ParameterKeys:
        if not (any(self.matrices().values()) or self.wheels or self.joints):
            raise ValueError(
                "a parameter changes nothing: give `stiffness`, `mass`, `damping`, `gyroscopic`, `wheels` or `joints`"
            )
        if self.unit.value == 0:
            raise ValueError("unit: the matrices cannot be for the value zero")
        known = [value for value in self.values if value.value or value.unit]
        if self.unit.unit and known and powers_of(self.unit) != powers_of(known[0]):
            raise ValueError(f"unit: {self.unit} and {known[0]} are of different dimensions")
        return self

    def matrices(self) -> dict[Letter, dict[str, ParameterMatrix]]:
        """Matrices by letter and component."""
        return {"K": self.stiffness, "M": self.mass, "D": self.damping, "G": self.gyroscopic}
