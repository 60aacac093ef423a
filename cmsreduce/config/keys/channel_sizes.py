"""Sizes of efforts and of measured motions: what counts as one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BeforeValidator, PlainSerializer, WithJsonSchema

from cmsreduce.config.keys.mapping import reported
from cmsreduce.config.keys.quantities import parse_quantity
from cmsreduce.errors import UnitsError
from cmsreduce.model import Channel, Units, units_of

__all__ = ["ChannelSize", "Kind", "Size", "channel_kind"]

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


@dataclass(frozen=True)
class Size:
    """A positive number and its unit, as written; a number alone is in the scene's units and radians.

    Parameters
    ----------
    si : float
        In N, N m, m, rad, m/s or rad/s; as written where there is no unit.
    kind : Kind, optional
        What the unit measures; None without one.
    written : str or float
        As written.
    """

    si: float
    kind: Kind | None
    written: str | float

    def worth(self, kind: Kind | None, units: Units) -> float:
        """Size in the scene's units.

        Parameters
        ----------
        kind : Kind, optional
            What the channel is; None for one that adds translations and rotations, which has no unit.
        units : Units
            Of the scene.

        Raises
        ------
        UnitsError
            If the unit is that of something else.
        """
        if self.kind is None:
            return self.si
        if kind is None:
            raise UnitsError(
                f"{self.written}: the channel adds translations and rotations, and has no unit: write a number"
            )
        if self.kind != kind:
            raise UnitsError(f"{self.written} is no {kind}, which the channel is: write e.g. {_EXAMPLE[kind]}")
        force = units.mass * units.length / units.time**2
        worth: dict[Kind, float] = {
            "force": force,
            "torque": force * units.length,
            "length": units.length,
            "angle": 1.0,
            "velocity": units.length / units.time,
            "angular velocity": 1 / units.time,
        }
        return self.si / worth[kind]


def channel_kind(channel: Channel, *, effort: bool) -> Kind | None:
    """What a unit of a channel is; None if it adds translations and rotations.

    Parameters
    ----------
    channel : Channel
    effort : bool
        Whether it is an actuator.
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
    # "2 N m" and "2 N*m" are written, too.
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
"""Largest effort of an actuator, or the motion of a sensor that counts as one: a number, or one with a unit."""
