"""Keys of actuators and sensors."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from cmsreduce.config.keys.mapping import (
    DofNames,
    Flag,
    Keys,
    Name,
    Number,
    PointName,
    Vector,
    exactly_one,
    parse_point,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import DOF_NAMES, Point, dof_index

__all__ = ["ActuatorKeys", "DofName", "Pair", "SensorKeys", "parse_row"]

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
        raise ValueError(f"both points are {value[0]}")
    return value


def parse_row(text: str) -> tuple[Point, int]:
    """Read ``body.point.dof``.

    Raises
    ------
    ValueError
        If it is not of this form.
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

    at: PointName | None = Field(
        default=None,
        description="Point of a body: COMPONENT.INTERFACE, COMPONENT.NODE, or COMPONENT.cg of a rigid one.",
        examples=["rotor.1200"],
    )
    joint: Name | None = Field(default=None, description="Joint whose relative motion it works on.", examples=["spin"])
    dof: DofName | None = Field(
        default=None, description="Dof of the joint; may be left out where only one is free.", examples=["rz"]
    )
    between: Pair | None = Field(
        default=None,
        description="Two points: works on the distance between them.",
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

    measure: Annotated[DofNames, Field(min_length=1)] | None = Field(
        default=None, description="Motions measured at the point; each is one output.", examples=[["rx", "ry", "rz"]]
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
