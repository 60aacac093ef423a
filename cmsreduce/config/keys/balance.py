"""Keys of the balance stage: rankings of modes, their weights and scales."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, PlainSerializer, Strict, WithJsonSchema, model_validator

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.channels import ChannelSize
from cmsreduce.config.keys.keep import STATES, KeepKeys
from cmsreduce.config.keys.mapping import Flag, Frequency, Keys, Number, Plain, exactly_one, refused, reported
from cmsreduce.config.keys.quantities import Quantity, parse_quantity
from cmsreduce.config.keys.scene import Band

__all__ = [
    "Arm",
    "BalanceKeys",
    "CLOSED_LOOP",
    "ClusterKeys",
    "ClusterLimit",
    "RankingKeys",
    "SYSTEM_COST",
    "ScalingKeys",
    "WeightingKeys",
]

Rank = Annotated[
    Literal["gregory", "hankel", "component-cost", "modal-gain", "frequency", "system-cost", "closed-loop"],
    refused(
        {
            "peak-amplitude": "is no longer a ranking: write gregory, which gives the same order",
            "moore": f"ranks states, not modes. {STATES}",
        }
    ),
]
SYSTEM_COST = "system-cost"
"""A ranking of the assembled system: coefficients compare modes of different bodies."""
CLOSED_LOOP = "closed-loop"
"""The same under the loop of a controller."""


class WeightingKeys(Keys):
    """A filter that weighs the modes by their frequencies; ``band`` alone stands for the scene's own band."""

    alternatives: ClassVar[tuple[str, ...]] = ("scene_band", "band_pass", "low_pass", "numerator")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "band"},)

    scene_band: Flag | None = Field(
        default=None,
        description="Band-pass over scene.band. Rankings by Gramians (hankel, component-cost) count exactly the "
        "response in the band; the others take the gain at each mode's frequency. Short: `weighting: band`.",
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
        """Read ``band`` as the band of the scene."""
        if value == "band":
            return {"scene_band": True}
        if not isinstance(value, (dict, Keys)):
            raise ValueError(f"`band` or a mapping is expected, e.g. {{low_pass: 2 Hz}}: found {found_in(value)}")
        return value

    @model_validator(mode="after")
    def _one_filter(self) -> WeightingKeys:
        exactly_one(self, self.alternatives, "weighting")
        return self


def _parse_arm(value: object) -> object:
    if value in ("auto", "none"):
        return value
    length = parse_quantity(value, "length")
    if length.value <= 0 or length.dimension not in (None, "length"):
        raise ValueError(f"a length above zero, auto or none is expected, e.g. 300 mm, found {found_in(value)}")
    return length


Arm = Annotated[
    Quantity | Literal["auto", "none"],
    BeforeValidator(reported(_parse_arm)),
    PlainSerializer(lambda value: value if isinstance(value, str) else value.plain),
    WithJsonSchema({"anyOf": [{"enum": ["auto", "none"]}, {"type": "number"}, {"type": "string"}]}),
]
"""Arm at which angles count as displacements: a length, ``auto`` or ``none``."""


class ScalingKeys(Keys):
    """Scales of inputs and outputs in a ranking; a lone length, auto or none stands for the first key."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = (
        {"enum": ["auto", "none"]},
        {"type": "number", "exclusiveMinimum": 0},
        {"type": "string"},
    )

    length: Arm = Field(
        default="auto",
        description="Arm at which rotations count as arcs and moments as forces, so that the ranking does not depend "
        "on the unit of length: auto for the body's radius of gyration, a length, or none to take radians as they are.",
        examples=["auto", "300 mm"],
    )
    inputs: dict[Plain, ChannelSize] = Field(
        default={},
        description="Effort of an actuator that counts as one, such as its largest effort. A number alone is in the "
        "scene's units. An actuator without a size is scaled by `length`.",
        examples=[{"motor": "2 Nm"}],
    )
    outputs: dict[Plain, ChannelSize] = Field(
        default={},
        description="Motion of a sensor that counts as one, such as the largest error allowed; SENSOR for all its "
        "motions, or SENSOR.DOF for one of them. A number alone is in the scene's units, radians, per second.",
        examples=[{"gyro": "10 arcsec"}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read a lone length, auto or none as a scaling without sizes."""
        return value if isinstance(value, (dict, Keys)) else {"length": value}


def _parse_limit(value: object) -> object:
    if value == "none":
        return 1.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 < value <= 1:
        raise ValueError(f"none or a correlation between 0 and 1 is expected, e.g. 0.1, found {found_in(value)}")
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
        "rotate": "Shapes of a cluster are not rotated any more. Take the key out: `rank: hankel` weighs the modes of "
        "a cluster together, and `keep: {frf_error: ...}` finds the fewest modes"
    }

    correlation: ClusterLimit = Field(
        default=0.1,
        description="Correlation of two modes' Gramians above which they belong to one cluster. With none, only "
        "repeated modes form clusters.",
        examples=[0.1],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read a lone correlation as a mapping with this key."""
        return value if isinstance(value, (dict, Keys)) else {"correlation": value}


class RankingKeys(Keys):
    """A ranking of modes and the rule for those to keep."""

    rank: Rank = Field(
        default="gregory",
        description="Order of the modes. gregory: modal influence coefficient; hankel: exact Hankel norm of the error "
        "without the mode, clusters as a whole; component-cost: share in the mean square response to white noise; "
        "modal-gain: INCA's criterion; frequency: lowest first; system-cost: share in the mean square response of "
        "the assembled system to white noise at its actuators, at the worst configuration; closed-loop: share in the "
        "squares of Hankel values weighed by the loop of scene.controller, at the worst configuration.",
        examples=["gregory"],
    )
    keep: KeepKeys = Field(
        default=KeepKeys(), description="Rule by which ranked modes are kept.", examples=[{"modes": 20}]
    )
    weighting: WeightingKeys | None = Field(
        default=None,
        description="Weight of frequencies: `band` for those of the scene, or a filter. By default all count alike; "
        "rankings by frequency, system-cost and closed-loop ignore it.",
        examples=["band"],
    )
    scaling: ScalingKeys = Field(
        default=ScalingKeys(),
        description="Scales of the channels: an arm for rotations, and optionally the size of each actuator's effort "
        "and of each sensor's motion.",
        examples=["auto", {"inputs": {"motor": "2 Nm"}, "outputs": {"gyro": "10 arcsec"}}],
    )
    clusters: ClusterKeys = Field(
        default=ClusterKeys(),
        description="Modes that act together: the correlation of Gramians above which modes form a cluster, which the "
        "hankel ranking takes as a whole. With none, only repeated modes form clusters.",
        examples=[0.1, {"correlation": 0.1}],
    )

    @model_validator(mode="after")
    def _compares_bodies(self) -> RankingKeys:
        if self.keep.rule == "total" and self.rank not in (SYSTEM_COST, CLOSED_LOOP):
            raise ValueError(
                f"keep.total compares modes of different bodies, but their coefficients of rank {self.rank} have "
                "different units: take rank system-cost, or state `modes` for each body"
            )
        return self


class BalanceKeys(RankingKeys):
    """Ranking of the modes by their influence in the scene, and the modes to keep."""

    sensitivity: Flag = Field(
        default=False,
        description="Repeat the choice with the bodies' damping times 0.2 and 5, and without each sensor. Modes that "
        "only some of these cases keep are marked as on the edge. With frf_error each case is a separate search.",
        examples=[True],
    )
