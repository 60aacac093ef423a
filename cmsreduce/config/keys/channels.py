"""Keys of actuators and sensors, and of the sizes of their efforts and motions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, WithJsonSchema, model_validator

from cmsreduce.config.keys.mapping import (
    Flag,
    Keys,
    Motions,
    Name,
    Number,
    PointName,
    Vector,
    exactly_one,
    parse_point,
    reported,
)
from cmsreduce.config.keys.quantities import parse_quantity
from cmsreduce.errors import SceneError, UnitsError
from cmsreduce.model import DOF_NAMES, Channel, Point, Units, dof_index, units_of

__all__ = ["ActuatorKeys", "ChannelSize", "DofName", "Kind", "Pair", "SensorKeys", "Size", "channel_kind", "parse_row"]

Kind = Literal["force", "torque", "length", "angle", "velocity", "angular velocity"]

_EFFORTS: dict[str, tuple[Kind, float]] = {
    **{name: ("force", value) for name, value in units_of("force").items()},
    **{name: ("torque", value) for name, value in units_of("torque").items()},
}
_EXAMPLE: dict[Kind, str] = {
    "force": "5 N",
    "torque": "2 Nm",
    "length": "1 mm",
    "angle": "10 arcsec",
    "velocity": "1 mm/s",
    "angular velocity": "0.01 deg/s",
}

_PLACES = ("at", "joint", "between", "rows")


def _check_dof(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (str, int)):
        return value
    try:
        return DOF_NAMES[dof_index(str(value))]
    except SceneError as error:
        raise ValueError(str(error)) from None


def _check_pair(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 2:
        raise ValueError(f"two points are expected, e.g. [rotor.tip, stator.base], found {len(value)}")
    if isinstance(value, (list, tuple)) and value[0] == value[1]:
        raise ValueError(f"both points are {value[0]}: name two different ones")
    return value


def parse_row(text: str) -> tuple[Point, int]:
    """Read ``body.point.dof``.

    Raises
    ------
    ValueError
        If the text has another form.
    """
    head, _, dof = text.rpartition(".")
    try:
        return parse_point(head), dof_index(dof)
    except (ValueError, SceneError):
        raise ValueError(f"'{text}' is no dof of a point: write COMPONENT.NODE.DOF, e.g. rotor.1300.rx") from None


def _check_row(text: str) -> str:
    parse_row(text)
    return text


def _check_rows(rows: dict[str, float]) -> dict[str, float]:
    if not any(rows.values()):
        raise ValueError("every weight is zero")
    return rows


def _check_direction(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError("a vector of length zero has no direction")
    return vector


def _check_place(value: object) -> object:
    if isinstance(value, str) and "." not in value:
        raise ValueError(
            f"'{value}' is no point: write COMPONENT.INTERFACE, COMPONENT.NODE or COMPONENT.cg, or for a channel in a "
            "joint `joint:` and `dof:`"
        )
    return value


DofName = Annotated[str, BeforeValidator(_check_dof)]
"""One of x y z rx ry rz, or a digit 1 to 6."""
Pair = Annotated[tuple[PointName, PointName], BeforeValidator(_check_pair)]
"""Two different points."""
Rows = Annotated[dict[Annotated[str, AfterValidator(_check_row)], Number], AfterValidator(_check_rows)]
"""Weights of COMPONENT.NODE.DOF."""
Direction = Annotated[Vector, AfterValidator(_check_direction)]
"""Vector that is not zero."""


class _ChannelKeys(Keys):
    alternatives: ClassVar[tuple[str, ...]] = _PLACES

    at: Annotated[PointName, BeforeValidator(_check_place)] | None = Field(
        default=None,
        description="Point of a body: COMPONENT.INTERFACE, COMPONENT.NODE, or COMPONENT.cg of a rigid one.",
        examples=["rotor.1200"],
    )
    joint: Name | None = Field(
        default=None, description="Joint whose relative motion is driven or measured.", examples=["spin"]
    )
    dof: DofName | None = Field(
        default=None, description="Dof of the joint; needed where several are free.", examples=["rz"]
    )
    between: Pair | None = Field(
        default=None,
        description="Two points; the distance between them is driven or measured.",
        examples=[["rotor.1200", "stator.12"]],
    )
    rows: Rows | None = Field(
        default=None,
        description="Weighted sum of motions COMPONENT.NODE.DOF, along the basic axes of each body.",
        examples=[{"rotor.1300.x": 1.0, "stator.12.ry": -2.0}],
    )

    def _place(self, what: str) -> str:
        place = exactly_one(self, _PLACES, what)
        if self.dof is not None and place != "joint":
            raise ValueError(f"`dof` goes with `joint`, not with `{place}`")
        return place


class ActuatorKeys(_ChannelKeys):
    """An input: a force or torque at a point, an effort in a joint or between two points, or rows."""

    force: Direction | None = Field(
        default=None, description="Force for a unit input, along the body's basic axes.", examples=[[0, 0, 1]]
    )
    torque: Direction | None = Field(
        default=None, description="Torque for a unit input, along the body's basic axes.", examples=[[0, 0, 1]]
    )

    @model_validator(mode="after")
    def _one_place(self) -> ActuatorKeys:
        place = self._place("an actuator")
        efforts = [key for key in ("force", "torque") if getattr(self, key) is not None]
        if place == "at" and len(efforts) != 1:
            raise ValueError("an actuator at a point needs one of `force` and `torque`, e.g. force: [0, 0, 1]")
        if place != "at" and efforts:
            raise ValueError(f"`{efforts[0]}` goes with `at`, not with `{place}`")
        return self


class SensorKeys(_ChannelKeys):
    """An output: motions of a point, of a joint, between two points, or rows."""

    measure: Annotated[Motions, Field(min_length=1)] | None = Field(
        default=None,
        description="Motions measured at the point; each is one output, in this order.",
        examples=[["rx", "ry", "rz"]],
    )
    rate: Flag = Field(default=False, description="Measure the rate instead of the motion.", examples=[True])

    @model_validator(mode="after")
    def _one_place(self) -> SensorKeys:
        place = self._place("a sensor")
        if place == "at" and self.measure is None:
            raise ValueError("a sensor at a point needs `measure`, e.g. measure: [rx, ry, rz]")
        if place != "at" and self.measure is not None:
            raise ValueError(f"`measure` goes with `at`, not with `{place}`")
        return self


@dataclass(frozen=True)
class Size:
    """A positive number and its unit, as written; a number alone is in the scene's units and radians.

    Parameters
    ----------
    si : float
        In N, N m, m, rad, m/s or rad/s; as written where there is no unit.
    kind : Kind, optional
        Kind of the unit; None without a unit.
    written : str or float
        As written.
    """

    si: float
    kind: Kind | None
    written: str | float

    def value_in(self, units: Units, kind: Kind | None) -> float:
        """Size in the scene's units.

        Parameters
        ----------
        units : Units
            Units of the scene.
        kind : Kind, optional
            Kind of the channel; None where it adds translations and rotations, which has no unit.

        Raises
        ------
        UnitsError
            If the unit does not fit the channel.
        """
        if self.kind is None:
            return self.si
        if kind is None:
            raise UnitsError(
                f"{self.written}: the channel adds translations and rotations, and has no unit: write a number"
            )
        if self.kind != kind:
            raise UnitsError(f"{self.written} is no {kind}, as the channel needs: write e.g. {_EXAMPLE[kind]}")
        force = units.mass * units.length / units.time**2
        unit: dict[Kind, float] = {
            "force": force,
            "torque": force * units.length,
            "length": units.length,
            "angle": 1.0,
            "velocity": units.length / units.time,
            "angular velocity": 1 / units.time,
        }
        return self.si / unit[kind]


def channel_kind(channel: Channel, *, effort: bool) -> Kind | None:
    """Kind of unit of a channel; None if the channel adds translations and rotations.

    Parameters
    ----------
    channel : Channel
    effort : bool
        True for an actuator, False for a sensor.
    """
    if channel.quantity == "combination":
        return None
    turns = channel.quantity == "rotation"
    if effort:
        return "torque" if turns else "force"
    if channel.rate:
        return "angular velocity" if turns else "velocity"
    return "angle" if turns else "length"


def _parse(value: object) -> Size:
    if isinstance(value, Size):
        return value
    size = _effort(value) or _motion(value)
    if not size.si > 0:
        raise UnitsError(f"{value}: the size of a channel is above zero, e.g. {_EXAMPLE['torque']}")
    return size


def _effort(value: object) -> Size | None:
    # "2 N m" and "2 N*m" are accepted, too.
    text = "".join(value.replace("*", "").split()) if isinstance(value, str) else ""
    unit = max((unit for unit in _EFFORTS if text.endswith(unit)), key=len, default="")
    if not unit or not isinstance(value, str):
        return None
    kind, factor = _EFFORTS[unit]
    return Size(parse_quantity(text.removesuffix(unit)).value * factor, kind, value)


def _motion(value: object) -> Size:
    rate = isinstance(value, str) and value.rstrip().endswith("/s")
    quantity = parse_quantity(value.rstrip()[:-2] if rate and isinstance(value, str) else value)
    written = value if isinstance(value, (str, int, float)) else str(value)
    match quantity.dimension:
        case None if not rate:
            return Size(quantity.value, None, written)
        case "length":
            return Size(quantity.to_si("length"), "velocity" if rate else "length", written)
        case "angle":
            return Size(quantity.to_si("angle"), "angular velocity" if rate else "angle", written)
        case "frequency" if not rate:
            return Size(2 * math.pi * quantity.to_si("frequency"), "angular velocity", written)
    raise UnitsError(f"{value} is no size of an effort or a motion; write e.g. {', '.join(_EXAMPLE.values())}")


ChannelSize = Annotated[
    Size,
    BeforeValidator(reported(_parse)),
    PlainSerializer(lambda size: size.written),
    WithJsonSchema({"anyOf": [{"type": "number", "exclusiveMinimum": 0}, {"type": "string"}]}),
]
"""Effort of an actuator, or motion of a sensor, that counts as one: a number, or a number with a unit."""
