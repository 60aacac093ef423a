"""Keys of the project stage: which modes of the system the bodies are to make again, and where."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from cmsreduce.config.keys.mapping import Count, Flag, Keys, Number, OneOrMore, Plain, Positive, exactly_one

__all__ = ["ProjectKeys", "SystemModeKeys"]


class SystemModeKeys(Keys):
    """Which modes of the whole system are projected on the bodies: one of the keys, or ``auto``."""

    alternatives: ClassVar[tuple[str, ...]] = ("cutoff", "list", "count")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "auto"},)

    cutoff_bands: Positive | None = Field(
        default=None,
        alias="cutoff",
        description="All elastic modes up to this multiple of the upper end of scene.band, at each configuration.",
        examples=[1.5],
    )
    list: Annotated[tuple[Annotated[Count, Field(ge=1)], ...], OneOrMore()] | None = Field(
        default=None,
        description="Elastic modes by number, in order of frequency, the first is 1; the same at each configuration.",
        examples=[[1, 2, 5]],
    )
    count: Count | None = Field(
        default=None,
        ge=1,
        description="So many elastic modes, the first by `rank` between actuators and sensors, at each configuration.",
        examples=[20],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """``auto`` is no rule: the error decides."""
        if value == "auto":
            return {}
        if isinstance(value, (str, int, float, list)):
            raise ValueError(f"`auto` or a mapping is expected, e.g. {{cutoff: 1.5}} or {{count: 20}}: found {value!r}")
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
    """Project modes of the whole system on the bodies, so that these make them again when they are joined."""

    modes: SystemModeKeys = Field(
        default=SystemModeKeys(),
        description="Which modes of the system: auto takes as few as frf_error allows.",
        examples=["auto"],
    )
    rank: Literal["hankel", "gregory"] = Field(
        default="hankel",
        description="What orders the system's modes for count and auto: exact Hankel values of what leaving them out "
        "costs, or Gregory's coefficient, their value where modes lie far apart.",
        examples=["hankel"],
    )
    configurations: Sampled = Field(
        default="all",
        description="Where the system's modes are taken: at all configurations of the scene, at those named, or auto: "
        "at the first, then at the one with the largest error, until frf_error holds at all of them.",
        examples=["all"],
    )
    of: Literal["reduced", "full"] = Field(
        default="reduced",
        description="What the system is made of: the bodies as the stages before leave them, or unreduced.",
        examples=["reduced"],
    )
    frf_error: Positive | None = Field(
        default=None,
        description="Error that auto goes for; by default that of balance.keep, of verify.limits, or 0.01.",
        examples=[0.01],
    )
    tolerance: Positive = Field(
        default=1e-8,
        lt=1,
        description="What a body holds of a system mode of unit modal mass up to this amplitude is no shape of its "
        "own. A larger one compresses: the modes then no longer return exactly, and the error is shown.",
        examples=[1e-8],
    )
    feedback: dict[Plain, dict[Plain, Number]] = Field(
        default={},
        description="Gains from sensors to actuators, effort = -gain x measurement, in the scene's units: the modes "
        "are then those of the closed loop, with all damping, and their real and imaginary parts are projected.",
        examples=[{"motor": {"gyro.rz": 12.0}}],
    )
    damped: Flag = Field(
        default=False,
        description="Take the complex modes of the system with all its damping, without feedback, too; their real and "
        "imaginary parts are projected.",
        examples=[True],
    )
    suppress: Flag = Field(
        default=False,
        description="Add static shapes of the interfaces, which move the modes that come along uncalled out of the "
        "band where they can.",
        examples=[True],
    )
    between: Flag = Field(
        default=True,
        description="Measure the error halfway between neighbouring angles, too, where no modes were taken.",
        examples=[True],
    )
