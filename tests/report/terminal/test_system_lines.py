"""Lines on the whole system: completeness at its worst configuration, singular values around the cut, the count."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import AxisCompleteness, ProjectionRecord, SampledModes
from cmsreduce.report.terminal.run import system_lines
from tests.report.conftest import MakeRun

SINGULAR = {"arm": np.array([2.0, 0.5, 3e-4, 2e-9, 1e-12]), "hub": np.zeros(0)}


def record(*sampled: SampledModes) -> ProjectionRecord:
    return ProjectionRecord(sampled, SINGULAR, {"arm": 3, "hub": 0}, tolerance=1e-8)


def at(name: str, extraneous: int, predicted: int | None, error: float = 1e-15) -> SampledModes:
    return SampledModes(name, np.array([1.0, 2.0]), np.array([0.0, error]), extraneous, predicted)


def test_nothing_measured_says_nothing(make_run: MakeRun) -> None:
    assert list(system_lines(make_run())) == []


def test_completeness_is_told_of_each_axis_where_it_is_worst(make_run: MakeRun) -> None:
    found = (
        AxisCompleteness("spin.rz", "first", 0.9, 0.01, 0.005, 0.99),
        AxisCompleteness("spin.rz", "second", 0.8, 0.03, 0.005, 0.97),
        AxisCompleteness("cone.ry", "first", 0.7, 0.2, 0.1),
    )
    spin, cone = system_lines(replace(make_run(), completeness=found))
    assert spin.startswith("hinge spin.rz: 3 % of the inertia is not represented (target 0 %) in 'second'")
    assert "in the band 80 %; with the hinges locked, the modes kept represent 97 % (target 100 %)" in spin
    assert "20 %" in cone and "locked" not in cone


@pytest.mark.parametrize(
    ("sampled", "said"),
    [
        (
            [at("a", 5, 5), at("b", 5, 5, 3e-14)],
            "after assembly 3e-14; 5 extraneous modes, as many as sum r_i",
        ),
        (
            [at("a", 5, 5), at("b", 6, 5)],
            "5 to 6 extraneous modes, not as many as sum r_i - rank(A_R) - n_R in 1",
        ),
        ([at("a", 5, None)], "5 extraneous modes"),
    ],
    ids=["as counted", "not as counted", "not counted"],
)
def test_singular_values_and_counts(make_run: MakeRun, sampled: list[SampledModes], said: str) -> None:
    arm, hub, line = system_lines(replace(make_run(), projection=record(*sampled)))
    assert arm.endswith(
        "on arm: 3 of 5 shapes are independent, singular values 2 to 0.0003, next 2e-09; tolerance 1e-08"
    )
    assert "on hub: 0 of 0 shapes are independent, singular values none" in hub
    assert f"projection of 2 modes in {len(sampled)} configuration" in line and said in line
