"""Keys of what a ranking takes account of: frequencies, units, clusters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema, model_validator

from cmsreduce.config.keys.channel_sizes import ChannelSize
from cmsreduce.config.keys.mapping import Flag, Frequency, Keys, Number, Plain, exactly_one, reported
from cmsreduce.config.keys.quantities import Quantity, parse_quantity
from cmsreduce.config.keys.scene import Band

__all__ = ["Arm", "ClusterKeys", "ClusterLimit", "ScalingKeys", "WeightingKeys"]


class WeightingKeys(Keys):
    """A filter that weighs the modes by their frequencies; ``band`` alone stands for the scene's own band."""

    alternatives: ClassVar[tuple[str, ...]] = ("scene_band", "band_pass", "low_pass", "numerator")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "band"},)

    scene_band: Flag | None = Field(
        default=None,
        description="Band-pass over scene.band: rankings by Gramians (hankel, component-cost) count what happens in it "
        "exactly, the others take the gain at each mode's frequency. Short: `weighting: band`.",
        examples=[True],
    )
    band_pass: Band | None = Field(
        default=None, description="Band-pass over another band.", examples=[["0.1 Hz", "5 Hz"]]
    )
    low_pass: Frequency | None = Field(
        default=None, gt=0, description="Bandwidth of a sensor or of a control loop.", examples=["2 Hz"]
    )
    order: Annotated[int, Strict(), Field(ge=1, le=2)] = Field(
        default=2, description="Order of the roll-off of a band or a low-pass: 1 or 2.", examples=[1]
    )
    numerator: tuple[Number, ...] | None = Field(
        default=None,
        min_length=1,
        description="Coefficients of a transfer function of s in rad/s, highest power first.",
        examples=[[1.0, 0.0]],
    )
    denominator: tuple[Number, ...] = Field(
        default=(1.0,), min_length=1, description="Its denominator, likewise.", examples=[[1.0, 62.8]]
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """``band`` is the scene's."""
        if value == "band":
            return {"scene_band": True}
        if not isinstance(value, (dict, Keys)):
            raise ValueError(f"`band` or a mapping is expected, e.g. {{low_pass: 2 Hz}}: found {value!r}")
        return value

    @model_validator(mode="after")
    def _one_filter(self) -> WeightingKeys:
        exactly_one(self, self.alternatives, "weighting")
        return self


def _parse_arm(value: object) -> object:
    if value in ("auto", "none"):
        return value
    length = parse_quantity(value)
    if length.value <= 0 or length.dimension not in (None, "length"):
        raise ValueError(f"a length above zero, auto or none is expected, e.g. 300 mm, found {value!r}")
    return length


def _plainly(value: Quantity | str) -> str | float:
    return value if isinstance(value, str) else str(value) if value.unit else value.value


Arm = Annotated[
    Quantity | Literal["auto", "none"],
    BeforeValidator(reported(_parse_arm)),
    PlainSerializer(_plainly),
    WithJsonSchema({"anyOf": [{"enum": ["auto", "none"]}, {"type": "number"}, {"type": "string"}]}),
]
"""Arm at which angles count as displacements: a length, the body's own, or none."""


class ScalingKeys(Keys):
    """What counts as one in a ranking; a length, auto or none alone stands for the first key."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = (
        {"enum": ["auto", "none"]},
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string"},
    )

    length: Arm = Field(
        default="auto",
        description="Arm at which rotations count as arcs and moments as forces, so that the unit of length does not "
        "decide: auto for the body's radius of gyration, a length, or none to take radians beside the scene's unit.",
        examples=["auto", "300 mm"],
    )
    inputs: dict[Plain, ChannelSize] = Field(
        default={},
        description="Effort of an actuator that counts as one, such as the largest it can give. A number alone is in "
        "the scene's units. What an actuator has no size for counts as `length` has it.",
        examples=[{"motor": "2 Nm"}],
    )
    outputs: dict[Plain, ChannelSize] = Field(
        default={},
        description="Motion of a sensor that counts as one, such as the largest that may be wrong; SENSOR for all it "
        "measures, or SENSOR.DOF for one of them. A number alone is in the scene's units, radians, per second.",
        examples=[{"gyro": "10 arcsec"}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """A length, auto or none is short for a scaling without sizes."""
        return value if isinstance(value, (dict, Keys)) else {"length": value}


def _parse_limit(value: object) -> object:
    if value == "none":
        return 1.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= 1:
        raise ValueError(f"none or a correlation between 0 and 1 is expected, e.g. 0.1, found {value!r}")
    return float(value)


ClusterLimit = Annotated[
    float,
    BeforeValidator(_parse_limit),
    WithJsonSchema({"anyOf": [{"const": "none"}, {"type": "number", "exclusiveMinimum": 0, "maximum": 1}]}),
]
"""Correlation above which modes act together; 1 for none."""


class ClusterKeys(Keys):
    """Modes that act together; a correlation alone stands for the key."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = (
        {"const": "none"},
        {"type": "number", "exclusiveMinimum": 0, "maximum": 1},
    )
    removed: ClassVar[Mapping[str, str]] = {
        "rotate": "Shapes of a cluster are not rotated any more. Take the key out: `rank: hankel` weighs modes of a "
        "cluster together, and `keep: {frf_error: ...}` finds the fewest modes"
    }

    correlation: ClusterLimit = Field(
        default=0.1,
        description="Correlation of two modes' Gramians above which they belong to one cluster; none for no clusters "
        "but repeated modes.",
        examples=[0.1],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """A correlation is short for a mapping with this key."""
        return value if isinstance(value, (dict, Keys)) else {"correlation": value}
