"""Keys of the stages reduce, project and verify."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Strict, Tag, model_validator

from cmsreduce.config.keys.balance import RankingKeys
from cmsreduce.config.keys.mapping import Count, Flag, Keys, Number, OneOrMore, Plain, Positive, exactly_one
from cmsreduce.model import DOF_NAMES

__all__ = [
    "CompareKeys",
    "FrfKeys",
    "LimitKeys",
    "ModeSetKeys",
    "ProjectKeys",
    "ReduceKeys",
    "SystemModeKeys",
    "VerifyKeys",
]

Method = Literal["craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan"]
NO_PARTS = {
    "parts": "Bodies are not reduced in parts any more. Take the key out: a factor that does not fit in memory is "
    "made in single precision, or on disk; `solver.memory` says how much it may take"
}
"""The key `parts` of earlier versions, with what to write instead."""

_CONSTRAINT_MODES = ("craig-bampton", "guyan")


def _check_residual(value: object) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if isinstance(text, str):
        node, _, dof = text.partition(".")
        if text in _ALL_OF_A_KIND or (node.isdigit() and (not dof or dof in DOF_NAMES)):
            return text
    raise ValueError(
        f"{value!r} is no residual: write sensors, actuators, dampers, or a node and a dof of it, e.g. 1200.z (dofs: "
        f"{', '.join(DOF_NAMES)})"
    )


def _check_cutoff(value: object) -> object:
    if isinstance(value, str) and value != "auto":
        raise ValueError(f"found the text '{value}', expected a number, e.g. 2.0, or auto")
    return value


Cutoff = Annotated[
    Annotated[float, Strict(), Field(gt=0), Tag("number")] | Annotated[Literal["auto"], Tag("auto")],
    Discriminator(lambda value: "auto" if isinstance(value, str) else "number"),
    BeforeValidator(_check_cutoff),
]
"""A multiple of the band, or ``auto``."""

_ALL_OF_A_KIND = ("sensors", "actuators", "dampers")
Residual = Annotated[str, BeforeValidator(_check_residual)]
"""Everything of a kind, or a node, or a dof of it."""


class ModeSetKeys(Keys):
    """A mode set, and up to which frequency."""

    method: Method = Field(
        default="craig-bampton",
        description="Mode set. craig-bampton: fixed-interface and constraint modes; macneal-rubin: free and residual "
        "modes; benfield-hruda: modes with the neighbours' stiffness and mass on the interface; augmented: modes with "
        "the mass of all that is outboard; guyan: constraint modes only.",
        examples=["craig-bampton"],
    )
    cutoff_bands: Cutoff = Field(
        default=2.0,
        alias="cutoff",
        description="Normal modes are kept up to this multiple of the upper end of scene.band. `auto`: from 1.5 times "
        "the band, raised for each body until the modes left out cost less than the error asked for.",
        examples=[2.0, "auto"],
    )
    interface_cutoff_bands: Positive | None = Field(
        default=None,
        alias="interface_cutoff",
        description="Interfaces of several nodes get characteristic constraint modes up to this multiple of the upper "
        "end of scene.band, instead of a constraint mode for each of their dofs. For craig-bampton and guyan.",
        examples=[5.0],
    )

    @model_validator(mode="after")
    def _has_constraint_modes(self) -> ModeSetKeys:
        if self.interface_cutoff_bands is not None and self.method not in _CONSTRAINT_MODES:
            raise ValueError(
                f"{self.method} has no constraint modes, so interface_cutoff does not apply to it: take it out, or "
                f"use {' or '.join(_CONSTRAINT_MODES)}"
            )
        if self.cutoff_bands == "auto" and self.method == "guyan":
            raise ValueError("guyan keeps no normal modes, so no cutoff can be found for it: take `cutoff: auto` out")
        return self


class ReduceKeys(ModeSetKeys):
    """Which mode set a body is reduced with, up to which frequency, and which loads it shall answer exactly."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS

    residuals: tuple[Residual, ...] = Field(
        default=(),
        description="Residual vectors, which make the static response exact: `sensors` for what they measure, "
        "`actuators` for their efforts (their dofs then leave the interface), `dampers` for the forces of a damping "
        "matrix of few dampers, NODE or NODE.DOF for unit loads there.",
        examples=[["sensors"]],
    )

    static_above_bands: Positive | None = Field(
        default=None,
        alias="static_above",
        description="Modes above this multiple of the upper end of scene.band are treated statically: they keep their "
        "stiffness and lose their mass, so that they ask for no small steps of an integrator.",
        examples=[8.0],
    )

    @property
    def own_points(self) -> tuple[str, ...]:
        """Residuals that name a node."""
        return tuple(text for text in self.residuals if text not in _ALL_OF_A_KIND)


class CompareKeys(RankingKeys):
    """Another model to show beside the run's own: other modes of the same sets, or another mode set."""

    reduce: ModeSetKeys | None = Field(
        default=None,
        description="Another mode set for every body that is reduced; keys left out are the body's own.",
        examples=[{"method": "macneal-rubin"}],
    )


class FrfKeys(Keys):
    """Where the frequency responses are compared."""

    points: Annotated[int, Strict(), Field(ge=2)] = Field(
        default=400,
        description="Points of the frequency grid over the band, before it is refined at resonances.",
        examples=[400],
    )


NotNegative = Annotated[float, Strict(), Field(ge=0)]
"""Number, 0 or more."""


class LimitKeys(Keys):
    """Largest errors that pass; a limit that is left out is not checked."""

    frf_error: Positive | None = Field(
        default=None,
        description="Relative error of the elastic response over the band, at the worst configuration.",
        examples=[0.05],
    )
    db_error: Positive | None = Field(
        default=None, description="99th percentile of the error in the band, in dB.", examples=[1.0]
    )
    frequency_error: Positive | None = Field(
        default=None, description="Relative error of the system's natural frequencies in the band.", examples=[1e-3]
    )
    damping_error: Positive | None = Field(
        default=None,
        description="Relative error of the damping ratios of the system's complex modes in the band.",
        examples=[0.05],
    )
    peak_error: Positive | None = Field(
        default=None, description="Relative error of the height of a channel's highest peak.", examples=[0.05]
    )
    frac_error: Positive | None = Field(
        default=None, description="1 less the frequency response assurance criterion of a channel.", examples=[0.01]
    )
    nrfd: Positive | None = Field(
        default=None, description="Relative shift of a resonance that a channel shows as a peak.", examples=[1e-3]
    )
    static_lack: Positive | None = Field(
        default=None,
        description="Share of the strain energy that a body lacks under a static load at an interface or actuator.",
        examples=[0.01],
    )
    gain_error: Positive | None = Field(
        default=None,
        description="Error of a static gain between channels, relative to the sum of the sizes of its modal gains.",
        examples=[0.01],
    )
    zero_error: Positive | None = Field(
        default=None, description="Relative shift of a transmission zero in the band.", examples=[0.01]
    )
    zeros_lost: NotNegative | None = Field(
        default=None, description="Zeros in the band that the reduced system has not, of one pair.", examples=[0]
    )
    step_error: Positive | None = Field(
        default=None,
        description="Root mean square error of a step response, relative.",
        examples=[0.01],
    )
    controller_ratio: Positive | None = Field(
        default=None,
        description="sigma_max(dG K) / sigma_min(I + G_R K) of scene.controller; just below 1 if it is left out.",
        examples=[0.5],
    )


CheckName = Literal["static", "gains", "zeros", "step"]
_CHECK_OF: dict[str, CheckName] = {
    "static_lack": "static",
    "gain_error": "gains",
    "zero_error": "zeros",
    "zeros_lost": "zeros",
    "step_error": "step",
}


class VerifyKeys(Keys):
    """Compare the reduced system with the full one at every configuration."""

    frf: FrfKeys = Field(default=FrfKeys(), description="Grid of the frequency responses.")
    limits: LimitKeys = Field(default=LimitKeys(), description="Errors beyond which the run fails.")
    checks: tuple[CheckName, ...] | None = Field(
        default=None,
        description="Checks beside the responses. static: strain energy that the bodies lack under loads at interfaces "
        "and actuators; gains: modal gains between channels; zeros: transmission zeros; step: step responses in time. "
        "Those named here, or by a limit, are done whatever they cost; by default static, gains and zeros, of bodies "
        "of up to 20000 dofs and full systems of up to 600 coordinates.",
        examples=[["static", "gains", "zeros", "step"]],
    )
    compare: dict[Plain, CompareKeys] = Field(
        default={},
        description="Other rankings and mode sets to show beside the model of the run, by label; limits do not apply "
        "to them.",
        examples=[{"by_frequency": {"rank": "frequency", "keep": {"modes": 19}}}],
    )

    @property
    def required_checks(self) -> tuple[CheckName, ...]:
        """Checks that are asked for by name, or by a limit on what they find."""
        limited = [check for figure, check in _CHECK_OF.items() if getattr(self.limits, figure) is not None]
        return tuple(dict.fromkeys([*(self.checks or ()), *limited]))


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
