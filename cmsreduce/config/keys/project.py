"""Keys under `project:`: system modes that are projected on the bodies."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.mapping import (
    Count,
    Flag,
    Keys,
    Number,
    OneOrMore,
    Plain,
    Positive,
    RelativeError,
    exactly_one,
)

__all__ = ["ProjectKeys", "SystemModeKeys"]


class SystemModeKeys(Keys):
    """System modes that are projected on the bodies: one of the keys, or ``auto``."""

    alternatives: ClassVar[tuple[str, ...]] = ("cutoff", "list", "count")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "auto"},)

    cutoff_bands: Positive | None = Field(
        default=None,
        alias="cutoff",
        description="All elastic modes up to this multiple of the upper end of scene.band, in each configuration.",
        examples=[1.5],
    )
    list: Annotated[tuple[Annotated[Count, Field(ge=1)], ...], OneOrMore()] | None = Field(
        default=None,
        description="Elastic modes by number in order of frequency, from 1, with all shapes of repeated ones; the same "
        "in each configuration.",
        examples=[[1, 2, 5]],
    )
    count: Count | None = Field(
        default=None,
        ge=1,
        description="Number of elastic modes, the first by `rank` from actuators to sensors, in each configuration.",
        examples=[20],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read ``auto`` as a mapping without a rule: the error decides."""
        if value == "auto":
            return {}
        if isinstance(value, (str, int, float, list)):
            raise ValueError(
                f"`auto` or a mapping is expected, e.g. {{cutoff: 1.5}} or {{count: 20}}: found {found_in(value)}"
            )
        return value

    @model_validator(mode="after")
    def _one_rule(self) -> SystemModeKeys:
        if self.model_fields_set:
            exactly_one(self, self.alternatives, "project.modes")
        return self

    @property
    def rule(self) -> str:
        """Name of the rule in force: ``auto``, ``cutoff``, ``list`` or ``count``."""
        given = self.given(self.alternatives)
        return given[0] if given else "auto"


Sampled = Annotated[
    Annotated[Literal["all", "auto"], Tag("word")] | Annotated[tuple[Plain, ...], Tag("names")],
    Discriminator(lambda value: "word" if isinstance(value, str) else "names"),
    BeforeValidator(lambda value: [value] if isinstance(value, str) and value not in ("all", "auto") else value),
]
"""``all``, ``auto``, or names of configurations."""


class ProjectKeys(Keys):
    """Projection of system modes, or of the scene's responses, on the bodies."""

    responses: Literal["auto"] | Count | dict[Plain, Count] | None = Field(
        default=None,
        description="Take shapes from the scene's own responses instead of system modes: the number of shapes of each "
        "body or of all bodies, or auto, the fewest that meet the limits of verify in all configurations and, with "
        "`between`, in the whole range of the articulation.",
        examples=["auto", {"rotor": 12, "stator": 7}],
    )
    modes: SystemModeKeys = Field(
        default=SystemModeKeys(),
        description="Modes of the system; auto takes the fewest with which frf_error is met.",
        examples=["auto"],
    )
    rank: Literal["hankel", "gregory"] = Field(
        default="hankel",
        description="Ranking of the system's modes for count and auto: exact Hankel norms of the error without each "
        "mode, or Gregory's coefficient, which equals them where modes are well separated.",
        examples=["hankel"],
    )
    configurations: Sampled = Field(
        default="all",
        description="Configurations in which the system's modes are computed: all of the scene, those named, or auto: "
        "the first, then the one with the largest error, until frf_error is met in all of them.",
        examples=["all"],
    )
    of: Literal["reduced", "full"] = Field(
        default="reduced",
        description="Bodies of the system: reduced by the earlier stages, or unreduced (full).",
        examples=["reduced"],
    )
    frf_error: RelativeError | None = Field(
        default=None,
        description="Error that auto must meet; by default that of balance.keep, of verify.limits, or 0.01.",
        examples=[0.01],
    )
    tolerance: Positive = Field(
        default=1e-8,
        lt=1,
        description="A part of a system mode (of unit modal mass) in a body with at most this amplitude adds no shape "
        "to the body. A larger tolerance gives fewer shapes: the system modes are then not reproduced exactly, and the "
        "error is reported.",
        examples=[1e-8],
    )
    feedback: dict[Plain, dict[Plain, Number]] = Field(
        default={},
        description="Gains from sensors to actuators, effort = -gain x measurement, in the scene's units. The modes "
        "are then those of the closed loop with all damping, and their real and imaginary parts are projected.",
        examples=[{"motor": {"gyro.rz": 12.0}}],
    )
    damped: Flag = Field(
        default=False,
        description="Take the complex modes of the system with all its damping, also without feedback; their real and "
        "imaginary parts are projected.",
        examples=[True],
    )
    suppress: Flag = Field(
        default=False,
        description="Add static shapes of the interfaces, which move extraneous modes out of the band where possible.",
        examples=[True],
    )
    between: Flag = Field(
        default=True,
        description="Also measure the error at midpoint configurations between neighbouring angles, where no modes "
        "were computed; with `responses`, in the whole range of the articulation.",
        examples=[True],
    )

    @model_validator(mode="after")
    def _of_responses(self) -> ProjectKeys:
        other = self.model_fields_set - {"responses", "of", "between"}
        if self.responses is not None and other:
            raise ValueError(
                f"`responses` takes no system modes: leave `{min(other)}` out (`of` and `between` stay possible)"
            )
        return self
