"""Keys of the stages reduce, project and verify."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Strict, Tag, model_validator

from cmsreduce.config.keys.balance import RankingKeys
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
from cmsreduce.model import DOF_NAMES

__all__ = [
    "RELATIVE_ERRORS",
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
"""A multiple of the band's upper end, or ``auto``."""

_ALL_OF_A_KIND = ("sensors", "actuators", "dampers")
Residual = Annotated[str, BeforeValidator(_check_residual)]
"""All of one kind, a node, or a dof of a node."""


class ModeSetKeys(Keys):
    """A mode set and its cutoffs."""

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
        description="Normal modes are kept up to this multiple of the upper end of scene.band. `auto` starts at 1.5 "
        "and raises the multiple of each body until the error of the omitted modes is below the error asked for.",
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
    """Mode set of a body, its cutoffs, and the loads whose static response it represents exactly."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS

    residuals: tuple[Residual, ...] = Field(
        default=(),
        description="Residual vectors, which make the static response exact: `sensors` for loads along the measured "
        "motions, `actuators` for their efforts (their dofs then leave the interface), `dampers` for the forces of a "
        "damping matrix of few dampers, NODE or NODE.DOF for unit loads there.",
        examples=[["sensors"]],
    )
    static_above_bands: Positive | None = Field(
        default=None,
        alias="static_above",
        description="Modes above this multiple of the upper end of scene.band are treated statically: they keep their "
        "stiffness and lose their mass, so that they do not force small steps of an integrator.",
        examples=[8.0],
    )

    @property
    def own_points(self) -> tuple[str, ...]:
        """Residuals that name a node."""
        return tuple(text for text in self.residuals if text not in _ALL_OF_A_KIND)


class CompareKeys(RankingKeys):
    """Another model for comparison: other modes of the same mode sets, or another mode set."""

    reduce: ModeSetKeys | None = Field(
        default=None,
        description="Another mode set for every body that is reduced; omitted keys are those of the body.",
        examples=[{"method": "macneal-rubin"}],
    )


class FrfKeys(Keys):
    """Frequency grid on which responses are compared."""

    points: Annotated[int, Strict(), Field(ge=2)] = Field(
        default=400,
        description="Points of the frequency grid over the band, before it is refined at resonances.",
        examples=[400],
    )


NotNegative = Annotated[float, Strict(), Field(ge=0)]
"""Number, 0 or more."""


class LimitKeys(Keys):
    """Largest errors that pass; an error without a limit is not checked. A relative error of one or more has its %."""

    frf_error: RelativeError | None = Field(
        default=None,
        description="Relative error of the elastic response over the band, at the worst configuration.",
        examples=[0.05],
    )
    channel_error: RelativeError | None = Field(
        default=None,
        description="Relative error of the elastic response of the worst channel; frf_error is that of all together.",
        examples=[0.1],
    )
    db_error: Positive | None = Field(
        default=None, description="99th percentile of the error in the band, in dB.", examples=[1.0]
    )
    frequency_error: RelativeError | None = Field(
        default=None,
        description="Relative error of the system's natural frequencies in the band, paired one to one by shape. It is "
        "not met if no mode has a partner, nor, without a limit modes_lost, if a mode that a channel shows has none: "
        "with 0.1 of its highest peak if modes were left out by their effect, else with 0.001.",
        examples=[1e-3],
    )
    modes_lost: NotNegative | None = Field(
        default=None,
        description="Number of modes in the band that the reduced system lacks, in one configuration.",
        examples=[0],
    )
    modes_extra: NotNegative | None = Field(
        default=None,
        description="Number of modes in the band that only the reduced system has, in one configuration.",
        examples=[0],
    )
    damping_error: RelativeError | None = Field(
        default=None,
        description="Relative error of the damping ratios of the system's complex modes in the band.",
        examples=[0.05],
    )
    peak_error: RelativeError | None = Field(
        default=None, description="Relative error of the height of a channel's highest peak.", examples=[0.05]
    )
    frac_error: RelativeError | None = Field(
        default=None, description="1 minus the frequency response assurance criterion of a channel.", examples=[0.01]
    )
    nrfd: RelativeError | None = Field(
        default=None, description="Relative shift of a resonance peak of a channel.", examples=[1e-3]
    )
    static_lack: RelativeError | None = Field(
        default=None,
        description="Share of the strain energy that the reduced body misses under a static load at an interface or "
        "actuator.",
        examples=[0.01],
    )
    gain_error: RelativeError | None = Field(
        default=None,
        description="Error of a static gain between channels, relative to the sum of magnitudes of its modal gains.",
        examples=[0.01],
    )
    zero_error: RelativeError | None = Field(
        default=None, description="Relative shift of a transmission zero in the band.", examples=[0.01]
    )
    zeros_lost: NotNegative | None = Field(
        default=None,
        description="Number of zeros in the band that the reduced system misses, for one input and output.",
        examples=[0],
    )
    step_error: RelativeError | None = Field(
        default=None,
        description="Relative root mean square error of a step response.",
        examples=[0.01],
    )
    controller_ratio: Positive | None = Field(
        default=None,
        description="sigma_max(dG K) / sigma_min(I + G_R K) of scene.controller; just below 1 without this key.",
        examples=[0.5],
    )


RELATIVE_ERRORS = frozenset(
    name for name, field in LimitKeys.model_fields.items() if field.annotation == (RelativeError | None)
)
"""Limits that are fractions, or per cent with their sign."""

CheckName = Literal["static", "gains", "zeros", "step"]
_CHECK_OF: dict[str, CheckName] = {
    "static_lack": "static",
    "gain_error": "gains",
    "zero_error": "zeros",
    "zeros_lost": "zeros",
    "step_error": "step",
}


class VerifyKeys(Keys):
    """Comparison of the reduced with the unreduced system at every configuration."""

    frf: FrfKeys = Field(default=FrfKeys(), description="Grid of the frequency responses.")
    limits: LimitKeys = Field(default=LimitKeys(), description="Errors above which the run fails.")
    checks: tuple[CheckName, ...] | None = Field(
        default=None,
        description="Checks in addition to the responses. static: strain energy that the bodies miss under loads at "
        "interfaces and actuators; gains: modal gains between channels; zeros: transmission zeros; step: step "
        "responses in time. Checks that are named here or have a limit are always done; by default static, gains and "
        "zeros, for bodies of up to 20000 dofs and unreduced systems of up to 600 coordinates.",
        examples=[["static", "gains", "zeros", "step"]],
    )
    between: Annotated[int, Strict(), Field(ge=0)] | Literal["all"] = Field(
        default=16,
        description="Largest number of midpoint configurations, midway between neighbouring angles, at which frf_error "
        "is measured and judged, too; `all`, or 0 for none, which a note then says.",
        examples=["all"],
    )
    compare: dict[Plain, CompareKeys] = Field(
        default={},
        description="Other rankings and mode sets to compare with the model of the run, by label; limits do not apply "
        "to them.",
        examples=[{"by_frequency": {"rank": "frequency", "keep": {"modes": 19}}}],
    )

    @property
    def required_checks(self) -> tuple[CheckName, ...]:
        """Checks that are named, or whose results have a limit."""
        limited = [check for figure, check in _CHECK_OF.items() if getattr(self.limits, figure) is not None]
        return tuple(dict.fromkeys([*(self.checks or ()), *limited]))


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
        description="Elastic modes by number in order of frequency, from 1; the same in each configuration.",
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
    """Projection of system modes on the bodies, so that the assembled bodies reproduce these modes."""

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
    frf_error: Positive | None = Field(
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
        "were computed.",
        examples=[True],
    )
