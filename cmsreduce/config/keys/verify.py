"""Keys under `verify:`: limits, checks, and models to compare with."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Strict

from cmsreduce.config.keys.balance import RankingKeys
from cmsreduce.config.keys.mapping import Decibels, Flag, Frequency, Keys, Plain, Positive, RelativeError
from cmsreduce.config.keys.reduce import ModeSetKeys
from cmsreduce.model import CHECK_OF, CheckName, Integrator

__all__ = ["RELATIVE_ERRORS", "CompareKeys", "CostKeys", "FrfKeys", "LimitKeys", "VerifyKeys"]


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
    db_error: Decibels | None = Field(
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
    hinge_inertia: RelativeError | None = Field(
        default=None,
        description="Share of the inertia at a hinge that is lost with the modes left out.",
        examples=[0.05],
    )
    highest_frequency: Annotated[Frequency, Field(gt=0)] | None = Field(
        default=None,
        description="Highest natural frequency of the assembled reduced system, which sets the step of an integrator.",
        examples=["500 Hz"],
    )
    controller_ratio: Positive | None = Field(
        default=None,
        description="sigma_max(dG K) / sigma_min(I + G_R K) of scene.controller, or that of K dG and K G_R where it is "
        "less; just below 1 without this key.",
        examples=[0.5],
    )


RELATIVE_ERRORS = frozenset(
    name for name, field in LimitKeys.model_fields.items() if field.annotation == (RelativeError | None)
)
"""Limits that are fractions, or per cent with their sign."""


class CostKeys(Keys):
    """Cost of a simulation in time, of the reduced and of the full system."""

    integrator: Integrator = Field(
        default="central_difference",
        description="Integrator of the steps and operations. An explicit one follows the highest frequency of the "
        "system, an implicit one (trapezoidal, generalised_alpha) the band.",
        examples=["rk4"],
    )
    accuracy: Annotated[RelativeError, Field(ge=1e-8, le=1e-2)] = Field(
        default=1e-2,
        description="Relative error of the frequency that sets the step, 1e-8 to 1 %.",
        examples=["0.1 %"],
    )
    measure: Flag = Field(
        default=False,
        description="Measure seconds for a simulated second, too, with the integrator of cmsreduce (docs/simulate.md); "
        "of the full system where no body has more than 600 dofs. It takes some seconds.",
        examples=[True],
    )


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
    cost: CostKeys = Field(
        default=CostKeys(),
        description="Cost of a simulation, computed for runs of up to 20000 dofs, and beyond if this key is given.",
        examples=[{"integrator": "rk4", "accuracy": "0.1 %", "measure": True}],
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
        limited = [check for figure, check in CHECK_OF.items() if getattr(self.limits, figure) is not None]
        return tuple(dict.fromkeys([*(self.checks or ()), *limited]))
