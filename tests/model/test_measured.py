"""A limit without a measured value says why, by the reasons of its own figure alone."""

from __future__ import annotations

import pytest

from cmsreduce.model import Measured, ReductionChecks

LARGE = "gains, zeros: the full system has 2400 coordinates"
DAMPED = "step: damping is a complex stiffness"
STATIC = "static completeness of rotor: it needs a factorisation of 900000 dofs"
LEFT_OUT = {LARGE: ("gains", "zeros"), DAMPED: ("step",), STATIC: ("static",)}


@pytest.mark.parametrize(
    ("figure", "reason"),
    [
        ("zero_error", LARGE),
        ("zeros_lost", LARGE),
        ("gain_error", LARGE),
        ("step_error", DAMPED),
        ("static_lack", STATIC),
        ("hinge_inertia", "no hinge turns freely without another, or the system is too large for all its modes"),
        ("highest_frequency", "the system is too large for all its modes"),
        ("frf_error", "no channel has an elastic response"),
        ("peak_error", "no channel has an elastic response"),
        ("controller_ratio", "the scene has no controller"),
    ],
)
def test_a_reason_is_that_of_the_figure(figure: str, reason: str) -> None:
    measured = Measured(
        configurations=(),
        limits={figure: 0.1},
        model="reduced",
        inputs=("motor",),
        outputs=("gyro",),
        checks=ReductionChecks(left_out=LEFT_OUT),
    )
    assert measured.findings[figure].note == f"not measured: {reason}"
