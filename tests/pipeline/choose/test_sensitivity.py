"""Sensitivity of the modes kept to the damping and to each sensor, against runs with these changes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.choose.sensitivity import changes
from tests.pipeline.study import CANTILEVER, Log

TABLE = "components.arm.damping={table: [[10, %g], [400, %g]]}"
# One mode hangs on the slope of this table, others on the sensors.
DAMPED = {
    "as it is": (TABLE % (0.01, 0.03), "components.panel.damping={modal: 0.01}"),
    "damping x 0.2": (TABLE % (0.002, 0.006), "components.panel.damping={modal: 0.002}"),
    "damping x 5": (TABLE % (0.05, 0.15), "components.panel.damping={modal: 0.05}"),
}
AT_5 = "balance={keep: {frf_error: 0.05}, sensitivity: true}"
# At this angle alone each change turns as many modes as at both of the study, or more.
ONE_ANGLE = "scene.articulation={hinge: [50 deg]}"
SENSORS = {
    "without gyro": "scene.sensors={probe: {at: panel.6, measure: [z]}}",
    "without probe": "scene.sensors={gyro: {at: hub.cg, measure: [ry, rz], rate: true}}",
}


@pytest.mark.parametrize(
    "rule",
    [
        "balance={rank: gregory, keep: {frf_error: 0.05}%s}",
        "balance={rank: hankel, keep: {fraction: 0.02}%s}",
        "balance={rank: component-cost, keep: {modes: 6}%s}",
        "balance={rank: system-cost, keep: {total: 9}%s}",
        "balance={keep: {bound: 0.2}%s}",
    ],
)
def test_each_case_is_what_a_run_of_its_own_keeps(opened: Callable[..., Run], rule: str) -> None:
    own = opened(rule % ", sensitivity: true", *DAMPED["as it is"], ONE_ANGLE)
    record = own.sensitivity
    assert record is not None
    found = {case.change: case.kept for case in record.cases}
    assert list(found) == ["damping x 0.2", "damping x 5", "without gyro", "without probe"]
    # Search or ranking, a change is made in one way for all rules.
    some = found if "frf_error" in rule else {change: found[change] for change in ("damping x 5", "without gyro")}
    for change, kept in some.items():
        damping = DAMPED.get(change, DAMPED["as it is"])
        run = opened(rule % "", ONE_ANGLE, *damping, *([SENSORS[change]] if change in SENSORS else []))
        assert kept is not None
        for name, columns in run.selection.items():
            np.testing.assert_array_equal(kept[name], columns + 1)


def test_modes_on_the_edge_are_marked_everywhere(opened: Callable[..., Run], study: Path) -> None:
    run = opened(AT_5, text=CANTILEVER)
    result = execute(run, study)
    assert result is not None and result.sensitivity is not None
    kept = {case.change: set((case.kept or {"arm": ()})["arm"]) for case in result.sensitivity.cases}
    assert list(kept) == ["damping x 0.2", "damping x 5", "without up", "without across"]
    own = set((run.selection["arm"] + 1).tolist())
    edge = {number for each in kept.values() for number in each ^ own}
    assert edge and set(result.sensitivity.edge("arm")) == edge
    # The summary, the tables and the page name them, each with the cases that turn it.
    summary = json.loads((run.folder / "summary.json").read_text())["sensitivity"]
    assert {each["mode"] for each in summary["on_the_edge"]["arm"]} == edge
    assert [case["kept_modes"]["arm"] for case in summary["cases"]] == [len(each) for each in kept.values()]
    (one,) = (case for case in summary["cases"] if case["change"] == "without up")
    assert set(one["left_out"]["arm"]) == own - kept["without up"] and one["left_out"]["arm"]
    number = one["left_out"]["arm"][0]
    assert "on the edge: left out" in result.components["arm"].modes.why[number - 1]
    assert "on the edge: left out" in (run.folder / "report.html").read_text()
    (note,) = (note for note in result.notes if note.startswith("sensitivity"))
    assert f"On the edge: arm {', '.join(map(str, sorted(edge)))}" in note
    shown = CliRunner().invoke(main, ["balance", str(study), "--set", AT_5])
    assert shown.exit_code == 0, shown.output
    marked = [line for line in shown.output.splitlines() if "edge " in line and line.split()[0].isdigit()]
    assert {int(line.split()[0]) for line in marked} == edge
    assert "arm: rotations count as arcs at" in shown.output and "its radius of gyration" in shown.output
    # A run that goes on from there has it in its store.
    again = Run(load_pipeline(study, [AT_5]), run.folder, Log())
    assert again.sensitivity == result.sensitivity
    assert "balance system.sensitivity" in again.stages.progress.reused_  # type: ignore[attr-defined]


def test_nothing_is_looked_at_unless_asked_for(opened: Callable[..., Run], study: Path) -> None:
    run = opened("balance.keep={modes: 4}")
    result = execute(run, study, report=False)
    assert result is not None and result.sensitivity is None
    assert json.loads((run.folder / "summary.json").read_text())["sensitivity"] is None
    assert not any("sensitivity" in text for text in run.stages.progress.done)  # type: ignore[attr-defined]


def test_a_rule_that_less_damping_breaks_is_told(opened: Callable[..., Run]) -> None:
    """All modes below a low cutoff meet 3 % with 1 % damping, but not with 0.2 %."""
    run = opened("balance={keep: {frf_error: 0.03}, sensitivity: true}", "reduce.cutoff=3", text=CANTILEVER)
    record = run.sensitivity
    assert record is not None
    failed = [case for case in record.cases if case.kept is None]
    assert failed[0].change == "damping x 0.2" and "cannot be met" in failed[0].failure
    assert "damping x 5" not in [case.change for case in failed]
    assert "damping x 0.2: no set of modes meets the rule" in record.note
    with pytest.raises(ConfigError, match="cannot be met"):
        _ = opened(
            "balance.keep={frf_error: 0.03}", "reduce.cutoff=3", "components.arm.damping.modal=0.002", text=CANTILEVER
        ).selection


def test_sensors_of_one_and_of_several_outputs(opened: Callable[..., Run]) -> None:
    names = [change.name for change in changes(opened("scene.sensors={gyro: {at: hub.cg, measure: [ry, rz]}}").scene)]
    assert names[2:] == ["without gyro.ry", "without gyro.rz"]
    names = [change.name for change in changes(opened("scene.sensors={gyro: {at: hub.cg, measure: ry}}").scene)]
    assert names == ["damping x 0.2", "damping x 5"]
