"""Keys of the balance stage: how modes are ranked, and how many stay."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AliasChoices,
    BeforeValidator,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Strict,
    Tag,
    model_validator,
)
from pydantic_core import CoreSchema

from cmsreduce.config.keys.mapping import Count, Flag, Keys, Name, Positive, refused
from cmsreduce.config.keys.ranking_options import ClusterKeys, ScalingKeys, WeightingKeys

__all__ = ["BalanceKeys", "KeepKeys", "RankingKeys"]

Rank = Annotated[
    Literal["gregory", "hankel", "component-cost", "modal-gain", "frequency", "system-cost"],
    refused({"peak-amplitude": "is no longer a ranking: write gregory, which gives the same order"}),
]
KeepRule = Literal["all", "modes", "total", "fraction", "frf_error", "bound"]


def _check_modes(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (int, dict)):
        raise ValueError(f"a number of modes or a mapping COMPONENT: NUMBER is expected, e.g. 20, found {value!r}")
    if isinstance(value, int) and value < 0:
        raise ValueError(f"{value} modes cannot be kept")
    return value


Modes = Annotated[
    Annotated[int, Strict(), Tag("number")] | Annotated[dict[Name, Count], Tag("mapping")],
    Discriminator(lambda value: "number" if isinstance(value, int) else "mapping"),
    BeforeValidator(_check_modes),
]
"""A number, or a number for each body named."""


class KeepKeys(Keys):
    """How many of the ranked modes stay: one of the keys, or ``all``."""

    alternatives: ClassVar[tuple[str, ...]] = ("modes", "total", "fraction", "hankel_fraction", "frf_error", "bound")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "all"},)

    modes: Modes | None = Field(
        default=None,
        description="Number of elastic modes that stay, for every body or by name; a body not named keeps all. "
        "Modes of one repeated frequency stay or go together: a number that would split them keeps the whole group.",
        examples=[20],
    )
    total: Count | None = Field(
        default=None,
        description="Number of elastic modes of all bodies together, wherever they are; for rank system-cost, whose "
        "coefficients compare modes of different bodies.",
        examples=[34],
    )
    fraction: Positive | None = Field(
        default=None,
        lt=1,
        validation_alias=AliasChoices("fraction", "hankel_fraction"),
        description="Modes with at least this fraction of their body's largest influence stay (also hankel_fraction).",
        examples=[1e-4],
    )
    frf_error: Positive | None = Field(
        default=None,
        description="The smallest model whose frf_error stays below this, at every configuration.",
        examples=[0.01],
    )
    bound: Positive | None = Field(
        default=None,
        description="The fewest modes of each body by itself with which its elastic response, at any frequency, is "
        "proven to err by less than this share of its largest value. The assembled system inherits no such bound.",
        examples=[0.05],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """``all`` is no rule at all."""
        if value == "all":
            return {}
        if isinstance(value, (str, int, float, list)):
            raise ValueError(
                f"`all` or a mapping is expected, e.g. {{modes: 20}} or {{frf_error: 0.01}}: found {value!r}"
            )
        return value

    @model_validator(mode="after")
    def _one_rule(self) -> KeepKeys:
        given = [
            name for name in ("modes", "total", "fraction", "frf_error", "bound") if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are two rules: keep one")
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema with the second name of a key, which pydantic leaves out."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        properties = schema["anyOf"][0]["properties"]
        properties["hankel_fraction"] = properties["fraction"]
        return schema

    @property
    def rule(self) -> KeepRule:
        """Name of the rule in force."""
        if self.modes is not None:
            return "modes"
        if self.total is not None:
            return "total"
        if self.fraction is not None:
            return "fraction"
        if self.bound is not None:
            return "bound"
        return "frf_error" if self.frf_error is not None else "all"

    def modes_of(self, component: str) -> int | None:
        """Elastic modes that a body keeps; None for all of them."""
        return self.modes.get(component) if isinstance(self.modes, Mapping) else self.modes


class RankingKeys(Keys):
    """A ranking and what is kept of it."""

    rank: Rank = Field(
        default="gregory",
        description="Order of the modes. gregory: modal influence coefficient; hankel: exact Hankel norm of what is "
        "lost, clusters seen whole; component-cost: share in the mean square response to white noise; modal-gain: "
        "INCA's criterion; frequency: lowest first; system-cost: share in the mean square response of "
        "the assembled system to white noise at its actuators, at the worst configuration.",
        examples=["gregory"],
    )
    keep: KeepKeys = Field(
        default=KeepKeys(), description="How many of the ranked modes stay.", examples=[{"modes": 20}]
    )
    weighting: WeightingKeys | None = Field(
        default=None,
        description="Which frequencies count: `band` for those of the scene, or a filter. All by default; a ranking by "
        "frequency or by system-cost takes no notice.",
        examples=["band"],
    )
    scaling: ScalingKeys = Field(
        default=ScalingKeys(),
        description="What counts as one: an arm for rotations, and where wanted the size of each actuator's effort and "
        "of each sensor's motion.",
        examples=["auto", {"inputs": {"motor": "2 Nm"}, "outputs": {"gyro": "10 arcsec"}}],
    )
    clusters: ClusterKeys = Field(
        default=ClusterKeys(),
        description="Which modes act together: the correlation of their Gramians above which they are a cluster, which "
        "the hankel ranking sees whole; none for no clusters but repeated modes.",
        examples=[0.1, {"correlation": 0.1}],
    )

    @model_validator(mode="after")
    def _compares_bodies(self) -> RankingKeys:
        if self.keep.rule == "total" and self.rank != "system-cost":
            raise ValueError(
                f"keep.total compares modes of different bodies, whose coefficients of rank {self.rank} have "
                "different units: take rank system-cost, or state `modes` for each body"
            )
        return self


class BalanceKeys(RankingKeys):
    """Rank the modes by their influence in the scene, and keep those that matter."""

    sensitivity: Flag = Field(
        default=False,
        description="Also choose with the bodies' damping times 0.2 and 5, and without each sensor, and mark the modes "
        "on the edge: those that some of these cases keep and the run does not, or the reverse. With frf_error each "
        "case is a search of its own.",
        examples=[True],
    )
