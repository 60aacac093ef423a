"""A finished stage is reused unless something it depends on has changed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.run.keys import read_key
from tests.frames import line
from tests.pipeline.study import arm, panel, write_body

STORED = ("reduce", "orthogonalise", "balance", "verify")
TIMED = {"seconds", "peak_mib", "speed", "seal"}
MODAL = ["orthogonalise arm", "orthogonalise panel"]
LAST = ["balance system", "verify system"]


def done(run: Run) -> list[str]:
    """Stages carried out, of those that are stored."""
    stored = [entry for entry in run.stages.progress.done if entry.split()[0] in STORED]
    return [entry for entry in stored if not entry.endswith("unreduced")]


def untimed(value: Any) -> Any:
    """A summary without wall times, memory, and the seal that holds them."""
    if isinstance(value, dict):
        return {key: untimed(item) for key, item in value.items() if key not in TIMED}
    return [untimed(item) for item in value] if isinstance(value, list) else value


def summary(study: Path) -> Any:
    return untimed(json.loads((study.parent / "out" / "summary.json").read_text()))


@pytest.fixture
def run_before(finished_study: Path, study: Path) -> None:
    """Put the results of a finished run of the study in its place."""
    shutil.copytree(finished_study / "out", study.parent / "out")


def test_a_second_run_computes_nothing_and_finds_the_same(opened: Callable[..., Run], study: Path) -> None:
    first = opened()
    execute(first, study, report=False)
    assert sorted(done(first)) == sorted(["reduce arm", "reduce panel", *MODAL, *LAST])
    found = summary(study)
    again = opened()
    result = execute(again, study, report=False)
    assert done(again) == []
    # The reference model, which is not stored, is for what is not verified yet.
    made = [[entry for entry in run.stages.progress.done if entry.startswith("reference")] for run in (first, again)]
    assert made[0] and not made[1]
    assert {*MODAL, *LAST} <= set(again.stages.progress.reused_)
    assert summary(study) == found
    assert result is not None
    for name, modal in again.kept.items():
        np.testing.assert_array_equal(modal.Phi, first.kept[name].Phi)
    for one, other in zip(first.verified.configurations, result.configurations, strict=True):
        np.testing.assert_array_equal(one.response.full, other.response.full)
    # What was reused keeps the time it took.
    assert result.components["arm"].seconds["reduce"] == first.stages.seconds["arm"]["reduce"]


@pytest.mark.usefixtures("run_before")
@pytest.mark.parametrize(
    ("setting", "redone"),
    [
        ("verify.limits.frf_error=0.5", []),
        ("write.all_nodes=true", []),
        ("name=another", []),
        ("components.arm.stiffness.file={folder}/moved.op4", []),
        ("components.arm.damping.modal=0.02", ["orthogonalise arm", *LAST]),
        ("components.panel.reduce.cutoff=10", ["reduce panel", "orthogonalise panel", *LAST]),
        ("scene.band=50 Hz", ["reduce arm", "reduce panel", *MODAL, *LAST]),
        ("scene.band=[1 Hz, 60 Hz]", LAST),
        ("reduce.method=guyan", ["reduce arm", "reduce panel", *MODAL, *LAST]),
        ("scene.articulation.hinge=[0, 20 deg]", LAST),
        ("scene.sensors={gyro: {at: hub.cg, measure: rz}}", LAST),
        # A dof that carries an actuator belongs to the interface set of its body.
        ("scene.actuators.thruster={at: panel.3, force: [0, 0, 1]}", ["reduce panel", "orthogonalise panel", *LAST]),
        ("components.hub.rigid.mass=6", LAST),
        ("balance.keep={fraction: 1e-3}", LAST),
        ("verify.frf.points=50", LAST),
        ("verify.compare={frequency: {rank: frequency}}", ["verify system"]),
    ],
)
def test_a_change_redoes_what_depends_on_it(
    opened: Callable[..., Run], study: Path, setting: str, redone: list[str]
) -> None:
    shutil.copy(study.parent / "arm.op4", study.parent / "moved.op4")
    run = opened(setting.replace("{folder}", str(study.parent)))
    execute(run, study, until=None if setting.startswith(("write", "name")) else "verify", report=False)
    assert sorted(done(run)) == sorted(redone)


def test_a_large_body_is_compared_with_modes_of_an_earlier_run(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small one is made again: that takes less time than to store and read it."""
    monkeypatch.setattr(import_module("cmsreduce.pipeline.bodies.reference"), "ALL_MODES_LIMIT", arm().n)
    assert panel().n > arm().n
    worst = []
    for setting in ("verify.frf.points=300", "verify.frf.points=500"):
        run = opened(setting)
        result = execute(run, study, report=False)
        assert result is not None
        worst.append(result.worst()["frf_error"])
    assert run.stages.progress.reused_.count("reference panel") == 1
    assert run.stages.progress.done.count("reference arm") == 1
    assert "reference panel" not in run.stages.progress.done
    shutil.rmtree(study.parent / "out")
    assert execute(opened(setting), study, report=False).worst()["frf_error"] == worst[1]


@pytest.mark.usefixtures("run_before")
def test_a_sensor_that_moves_is_told_what_the_modes_miss(
    opened: Callable[..., Run], study: Path, finished_study: Path
) -> None:
    """Sensors change no mode, so that these are reused; the note on the flexibility there is that of a fresh run."""
    moved = "scene.sensors.gyro={at: arm.3, measure: [ry, rz], rate: true}"
    noted, redone = [], []
    for setting in (moved, "verify.frf.points=60", moved):
        run = opened(setting)
        execute(run, study, report=False)
        noted.append([note for note in summary(study)["notes"] if "no static shape for sensor" in note])
        redone.append([entry for entry in done(run) if entry not in LAST])
    assert redone == [["reduce arm"], [], []]
    assert {note.partition(" and lacks")[0] for note in noted[0]} == {
        f"arm: its basis has no static shape for sensor 'gyro.{dof}'" for dof in ("ry", "rz")
    }
    assert (noted[1], noted[2]) == ([], noted[0])
    shutil.rmtree(study.parent / "out")
    execute(opened(moved), study, report=False)
    assert [note for note in summary(study)["notes"] if "no static shape for sensor" in note] == noted[0]


def test_what_a_choice_by_cost_depends_on_is_in_its_key(opened: Callable[..., Run]) -> None:
    for rule, same in (("{limits: all, minimise: cost}", False), ("limits", True)):
        asked = [f"balance.keep={rule}", "verify.limits.db_error=1.0", "verify.cost.integrator="]
        runs = [opened(*asked[:2], asked[2] + each) for each in ("central_difference", "trapezoidal")]
        assert (runs[0]._system_key("balance") == runs[1]._system_key("balance")) == same


def test_points_of_a_sweep_that_hold_a_stiffened_body_elsewhere_do_not_share_it(opened: Callable[..., Run]) -> None:
    stiffened = "components.arm.geometric_stiffness={bars: all}"
    held = [f"write.frame={{kind: clamped, at: {face}}}" for face in ("root", "tip")]
    ends = "components.panel.interfaces={root: {node: 1}, tip: {node: 5}}"
    pipelines = [opened(stiffened, ends, frame).pipeline for frame in held]
    assert len({read_key(each, "arm") for each in pipelines}) == 2
    assert len({read_key(each, "panel") for each in pipelines}) == 1


@pytest.mark.usefixtures("run_before")
def test_a_body_whose_file_changed_is_read_anew(opened: Callable[..., Run], study: Path) -> None:
    write_body(study.parent, line("arm", [0, 0, 0], [0.8, 0, 0], 4, masses={3: 0.5}))
    run = opened()
    execute(run, study, report=False)
    assert sorted(done(run)) == sorted(["reduce arm", "orthogonalise arm", *LAST])


@pytest.mark.usefixtures("run_before")
@pytest.mark.parametrize("damage", [b"", b"no HDF5", None], ids=["empty", "other", "cut"])
def test_a_damaged_stage_is_made_again(opened: Callable[..., Run], study: Path, damage: bytes | None) -> None:
    found = summary(study)
    for stage in ("system.verify.h5", "arm.orthogonalise.h5"):
        path = study.parent / "out" / "stages" / stage
        path.write_bytes(path.read_bytes()[:3000] if damage is None else damage)
    run = opened()
    execute(run, study, report=False)
    assert sorted(done(run)) == ["orthogonalise arm", "verify system"]
    assert summary(study) == found
