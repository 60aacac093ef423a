"""Stages one by one: what each leaves on disk, and what it asks for."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.errors import ReadError, StageError, WriteError
from cmsreduce.pipeline import Run, execute, reopen, reopened_result, run_result
from tests.pipeline.study import PIPELINE, Log
from tests.pipeline.test_reuse import done

READ = {"stages/arm.read.h5", "stages/panel.read.h5"}
REDUCED = READ | {"stages/arm.reduce.h5", "stages/panel.reduce.h5"}
MODAL = REDUCED | {"stages/arm.orthogonalise.h5", "stages/panel.orthogonalise.h5"}
BALANCED = MODAL | {"stages/system.balance.h5"}
ASSEMBLED = BALANCED | {"system.h5"}
VERIFIED = ASSEMBLED | {"stages/system.verify.h5"}
WRITTEN = VERIFIED | {"arm.h5", "panel.h5", "summary.json", "report.html"}
ORDER = {
    "reduce": REDUCED,
    "orthogonalise": MODAL,
    "balance": BALANCED,
    "assemble": ASSEMBLED,
    "verify": VERIFIED,
    "write": WRITTEN,
}


def files(study: Path) -> set[str]:
    out = study.parent / "out"
    return {str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()} - {
        "stages/origin.json",
        "stages/written.json",
    }


@pytest.mark.parametrize("stage", ORDER)
def test_until_a_stage(opened: Callable[..., Run], study: Path, stage: str) -> None:
    run = opened()
    result = execute(run, study, until=stage)
    assert files(study) == ORDER[stage]
    assert (result is not None) == (stage == "write")
    assert {path.relative_to(study.parent / "out").as_posix() for path in run.stages.written} <= ORDER[stage]


def test_one_verb_after_the_other_makes_the_whole(study: Path) -> None:
    """As in a makefile: each verb finds what the one before it left."""
    there: set[str] = set()
    for verb, left in ORDER.items():
        result = CliRunner().invoke(main, [verb, str(study)])
        assert result.exit_code == 0, result.output
        assert files(study) == left
        new = {line.removeprefix("wrote ") for line in result.stdout.splitlines() if line.startswith("wrote ")}
        if verb != "write":
            assert new == {str(study.parent / "out" / name) for name in left - there}
        there = left


@pytest.mark.parametrize("verb", [verb for verb in ORDER if verb not in ("reduce", "write")])
def test_a_verb_without_what_it_builds_on_is_refused(opened: Callable[..., Run], study: Path, verb: str) -> None:
    with pytest.raises(StageError, match=f"not finished .* run `cmsreduce .*--until {verb}"):
        execute(opened(only=verb), study)
    assert files(study) == READ


def test_a_verb_does_its_stage_again_and_no_other(opened: Callable[..., Run], study: Path) -> None:
    execute(opened(), study)
    run = opened(only="balance")
    execute(run, study)
    assert done(run) == ["balance system"]


def test_a_verb_with_new_settings_asks_for_the_stages_before(opened: Callable[..., Run], study: Path) -> None:
    execute(opened(), study)
    with pytest.raises(StageError, match="stage 'orthogonalise' of 'arm' is not finished for these inputs"):
        execute(opened("components.arm.damping.modal=0.05", only="verify"), study)


def test_a_stage_that_the_pipeline_does_not_name_is_not_run(opened: Callable[..., Run], study: Path) -> None:
    run = opened("balance=null", "verify=null", "write=null")
    result = execute(run, study)
    assert files(study) == MODAL | {"summary.json", "report.html"}
    assert result is not None and result.configurations == () and result.verdict.word == "not checked"
    assert {entry.split()[0] for entry in done(run)} == {"reduce", "orthogonalise"}
    assert result.components["arm"].kept.size == 17


def test_the_system_file_holds_the_assembled_matrices(opened: Callable[..., Run], study: Path) -> None:
    run = opened()
    execute(run, study, until="assemble")
    with h5py.File(study.parent / "out" / "system.h5") as file:
        for number, configuration in enumerate(run.scene.configurations):
            group = file[f"configuration_{number}"]
            system = run.model.assembled.system(configuration)
            assert group.attrs["name"] == configuration.name
            for name in ("M", "K", "D", "B", "C1", "C2"):
                np.testing.assert_array_equal(group[name][()], getattr(system, name), err_msg=name)
            # 17 + 19 modes and 6 rigid motions, 6 + 5 of which the joints lock; one hinge stays free.
            assert group["M"].shape == (17 + 19 + 6 - 11, 17 + 19 + 6 - 11)
            assert group["rigid"].shape[1] == 7


def test_a_finished_run_opens_again_and_computes_nothing(opened: Callable[..., Run], study: Path) -> None:
    first = execute(opened("verify.frf.points=50"), study, ["verify.frf.points=50"])
    again = run_result(reopen(study.parent / "out"))
    assert first is not None
    assert again.worst() == first.worst()
    assert again.components["panel"].seconds["reduce"] == first.components["panel"].seconds["reduce"]


def test_a_refused_pipeline_does_not_take_the_place_of_the_finished_one(
    opened: Callable[..., Run], study: Path
) -> None:
    execute(opened(), study)
    with pytest.raises(Exception, match="joined to nothing"):
        execute(opened("scene.joints={weld: {connect: [hub.face, arm.root]}}", "scene.articulation=null",
                       "scene.actuators={push: {at: hub.cg, force: [1, 0, 0]}}"), study, ["broken"])  # fmt: skip
    assert reopen(study.parent / "out").pipeline.name == "study"


def test_stages_of_other_settings_do_not_take_the_place_of_a_finished_run(
    opened: Callable[..., Run], study: Path
) -> None:
    """Page and summary of one folder would give two verdicts."""
    out, other = study.parent / "out", "reduce.cutoff=10"
    first = execute(opened(), study)
    execute(opened(other), study, [other], until="verify")
    with pytest.raises(StageError, match="not finished for these inputs and settings"):
        reopened_result(out)
    # The pipeline itself is changed, and the results stay those of the one before.
    changed = PIPELINE.replace("cutoff: 15", "cutoff: 10")
    execute(opened(text=changed), study, until="verify")
    with pytest.raises(ReadError, match=r"summary\.json: it is of other settings than the finished stages"):
        reopened_result(out)
    execute(opened(text=changed), study)
    assert first is not None and reopened_result(out)[1].worst() != first.worst()


def test_only_a_run_directory_opens_again(study: Path) -> None:
    with pytest.raises(ReadError, match="no run directory"):
        reopen(study.parent)


class Remover(Log):
    """Listener that removes the run directory when a stage begins."""

    def __init__(self, folder: Path, moment: str) -> None:
        super().__init__()
        self.folder, self.moment = folder, moment

    def stage(self, stage: str, what: str) -> None:
        super().stage(stage, what)
        if stage == self.moment:
            shutil.rmtree(self.folder)


@pytest.mark.parametrize(("until", "moment", "lost"), [(None, "write", "summary"), ("verify", "verify", "arm.reduce")])
def test_files_that_are_gone_when_a_run_ends_are_named(
    opened: Callable[..., Run], study: Path, until: str | None, moment: str, lost: str
) -> None:
    run = opened()
    run.stages.progress = Remover(run.folder, moment)
    with pytest.raises(WriteError, match=rf"out: .*{lost}.*: written by this run, and gone: .*; run again"):
        execute(run, study, until=until)
    execute(opened(), study, until=until)


def test_stages_that_are_gone_when_a_run_ends_lose_no_result(opened: Callable[..., Run], study: Path) -> None:
    run = opened()
    run.stages.progress = Remover(run.folder, "balance")
    result = execute(run, study)
    assert result is not None and result.verdict.word == "PASS"
    assert files(study) >= {"summary.json", "report.html", "arm.h5", "panel.h5", "system.h5"}
