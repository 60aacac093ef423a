"""The next thing to try after a broken limit depends on what the run kept, compared and measured."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cmsreduce.model import ReductionChecks, RunResult
from cmsreduce.report.next_steps import next_steps
from tests.report.conftest import MakeRun


def all_kept(run: RunResult) -> RunResult:
    components = {name: replace(part, kept=np.arange(3)) for name, part in run.components.items()}
    return replace(run, components=components)


def test_modes_left_out_come_first(make_run: MakeRun) -> None:
    (step,) = next_steps(make_run(limits={"frf_error": 0.001, "db_error": 0.01}))
    assert step.startswith("1 mode of the mode sets was left out") and "keep: limits" in step


@pytest.mark.parametrize(
    ("reduce", "says"),
    [
        ({"method": "craig-bampton", "cutoff": 2.0}, "raise `reduce.cutoff` from 2 to 4, or take `method: macneal-"),
        ({"cutoff": 0.5}, "from 0.5, which is short for a band up to"),
        ({"cutoff": "auto"}, "raise `reduce.cutoff`"),
    ],
)
def test_then_the_cutoff(make_run: MakeRun, reduce: dict[str, Any], says: str) -> None:
    run = all_kept(make_run(limits={"frf_error": 0.001}, settings={"reduce": reduce}))
    (step,) = next_steps(run)
    assert "all modes of the mode sets were kept" in step and says in step


@pytest.mark.parametrize(
    ("method", "settings", "inertia"),
    [
        ("craig-bampton", {}, True),
        ("craig-bampton", {"reduce": {"inertia": True}}, False),
        ("craig-bampton", {"components": {"rotor": {"reduce": {"inertia": True}}}}, False),
        ("benfield-hruda", {}, False),
        ("augmented", {}, False),
    ],
)
def test_inertia_is_named_where_a_mode_set_takes_it_and_lacks_it(
    make_run: MakeRun, method: str, settings: dict[str, Any], inertia: bool
) -> None:
    run = all_kept(make_run(limits={"frf_error": 0.001}, settings=settings))
    parts = {name: replace(part, modes=replace(part.modes, method=method)) for name, part in run.components.items()}
    (step,) = next_steps(replace(run, components=parts))
    assert "`method: macneal-rubin`" in step and ("`inertia: true`" in step) is inertia


def test_scene_shapes_have_no_cutoff_to_raise(make_run: MakeRun) -> None:
    run = all_kept(make_run(limits={"frf_error": 0.001}))
    parts = {name: replace(part, modes=replace(part.modes, method="scene")) for name, part in run.components.items()}
    (step,) = next_steps(replace(run, components=parts))
    assert step.startswith("scene shapes are made for `frf_error`") and "cutoff" not in step


def test_a_compared_mode_set_that_meets_the_limit_is_named(make_run: MakeRun) -> None:
    keys = {"method": "macneal-rubin", "cutoff": 2.0}
    settings = {"reduce": {"cutoff": 2.0}, "verify": {"compare": {"better": {"reduce": keys}}}}
    run = all_kept(make_run(limits={"frf_error": 0.001}, settings=settings, compared=("better",)))
    assert "macneal-rubin" in next_steps(run)[0] and "'better'" not in next_steps(run)[0]
    good = tuple(
        replace(result, errors={**result.errors, "better": replace(result.errors["better"], frf_error=1e-5)})
        for result in run.configurations
    )
    assert next_steps(replace(run, configurations=good)) == (
        "the compared model 'better' meets this limit: `reduce: {method: macneal-rubin, cutoff: 2.0}`",
    )


def test_a_limit_without_channels_asks_for_them(make_run: MakeRun) -> None:
    run = replace(make_run(configurations=(), speed=None, limits={"frf_error": 0.1}), inputs=(), outputs=())
    assert next_steps(run) == ("name the scene's actuators and sensors under `scene:`",)


def test_a_search_that_was_made_is_not_proposed_again(make_run: MakeRun) -> None:
    settings = {"balance": {"keep": {"limits": "all"}}, "reduce": {"cutoff": 2.0}}
    (step,) = next_steps(make_run(limits={"frf_error": 0.001}, settings=settings))
    assert "keep: limits" not in step and "raise `reduce.cutoff` from 2 to 4" in step


def test_without_damping_no_cutoff_is_high_enough(make_run: MakeRun) -> None:
    run = all_kept(make_run(limits={"frf_error": 0.001, "frequency_error": 1e-12}))
    parts = {
        name: replace(part, modes=replace(part.modes, zeta=np.zeros_like(part.modes.zeta)))
        for name, part in run.components.items()
    }
    still = tuple(
        replace(result, errors={name: replace(each, damped=None) for name, each in result.errors.items()})
        for result in run.configurations
    )
    undamped = replace(run, components=parts, configurations=still)
    steps = next_steps(undamped)
    assert steps[0].startswith("nothing in the system is damped") and "cutoff" not in steps[0]
    assert any("raise `reduce.cutoff`" in step for step in steps[1:])
    assert not any("damped" in step for step in next_steps(run))


@pytest.mark.parametrize("given", [[], ["sensors"], ["sensors", "actuators"]])
def test_residual_vectors_that_are_there_are_not_proposed(make_run: MakeRun, given: list[str]) -> None:
    run = make_run(limits={"static_lack": 0.01}, settings={"reduce": {"residuals": given}})
    run = replace(run, checks=ReductionChecks({"rotor": {"interface 'tip'": 0.02}}))
    assert [finding.name for finding in run.verdict.broken] == ["static_lack"]
    steps = next_steps(run)
    assert steps == () if len(given) == 2 else "residuals: [actuators, sensors]" in steps[0]
