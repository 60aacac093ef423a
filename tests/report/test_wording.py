import math
from dataclasses import replace

import pytest

from cmsreduce.model import Finding
from cmsreduce.report.verdict import verdict_lines
from cmsreduce.report.wording import FIGURES, headline, number, place, worst
from tests.report.sweeps import made_sweep


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 4, "0"),
        (1.23456, 4, "1.235"),
        (123456.7, 4, "123457"),
        (99.95, 3, "100"),
        (-0.00012345, 3, "-0.000123"),
        (4.2e-16, 4, "4.2e-16"),
        (math.nan, 4, "no value"),
        (math.inf, 4, "infinite"),
    ],
)
def test_number(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


@pytest.mark.parametrize(
    ("which", "value", "text"), [(0, 0.0123456, "1.23 %"), (2, 0.5, "0.5 dB"), (3, 1e-4, "0.01 %")]
)
def test_figure_has_its_unit(which: int, value: float, text: str) -> None:
    assert FIGURES[which].text(value) == text


def test_headline_names_the_worst_configuration(make_run) -> None:
    run = make_run(bodies=("rotor", "stator"))
    assert headline(run) == "4 elastic modes → 2 kept; worst response error 2 % at spin=45 cone=30"


def test_headline_without_verification(make_run) -> None:
    assert headline(make_run(configurations=())) == "2 elastic modes → 1 kept; no response was verified"


def test_worst_of_a_compared_model(make_run) -> None:
    found = worst(make_run(), "first by frequency")
    assert [(w.value, w.note) for _, w in found] == [(0.75, "spin=0"), (24.0, "spin=0"), (0.0, "spin=0")]
    assert [w.verdict for _, w in found] == ["FAIL", "FAIL", "info"]


def test_a_value_that_is_no_number_is_the_worst(make_run) -> None:
    run = make_run()
    second = run.configurations[1]
    spoilt = replace(second, errors={"reduced": replace(second.errors["reduced"], db_error=math.nan)})
    _, found = worst(replace(run, configurations=(run.configurations[0], spoilt)), "reduced")[1]
    assert math.isnan(found.value)
    assert (found.note, found.passed) == ("spin=45 cone=30", False)


def test_broken_limits_and_checks_are_named(make_run) -> None:
    run = make_run(limits={"frf_error": 0.015, "db_error": 1.0})
    rotor = replace(run.components["rotor"], checks=(Finding("orthogonality in M", 1e-3, 1e-8, "at node 5"),))
    assert verdict_lines(replace(run, components={"rotor": rotor}).verdict) == [
        ("FAIL", "response error 2 % at spin=45 cone=30 is above its limit 1.5 %"),
        ("FAIL", "rotor: orthogonality in M is 0.001, above its limit 1e-08: at node 5"),
    ]
    assert verdict_lines(make_run().verdict) == []


def test_the_scene_as_built_is_named_as_such(make_run) -> None:
    assert place("spin=45") == "at spin=45"
    assert headline(make_run(configurations=("as built",))).endswith("response error 1 % in the scene as built")


def test_results_have_a_short_repr(make_run) -> None:
    run, sweep = repr(make_run()), repr(made_sweep())
    assert run.startswith("<RunResult oscillators: PASS, components 1, configurations 2, frf_error 0.02")
    assert sweep.startswith("<SweepResult ") and "passed" in sweep
    assert max(len(run), len(sweep)) < 200
