"""A run replaces and `cache clear` removes only files that cmsreduce wrote."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import h5py
import pytest
from ruamel.yaml import YAML

from tests.cli.test_sweep import call


@pytest.mark.parametrize("name", ["arm.h5", "system.h5", "summary.json", "report.html", "panel.SID_FEM"])
def test_a_foreign_file_is_not_replaced(study: Path, name: str) -> None:
    out = study.parent / "out"
    out.mkdir(exist_ok=True)
    path = out / name
    if name.endswith(".h5"):
        with h5py.File(path, "w") as file:
            file["mine"] = 1.0
    else:
        path.write_text(json.dumps({"mine": 1}))
    before = path.read_bytes()
    found = call("run", study, "--quiet", "--set", "write.formats=[hdf5, sid]")
    assert found.exit_code == 2 and f"{path}: a file of this name is there that cmsreduce did not write" in found.stderr
    assert "choose another `output:`" in found.stderr
    assert path.read_bytes() == before
    assert not (out / "stages").exists(), "refused before anything is computed"


def test_a_result_that_may_not_be_read_is_said_to_be_so(ran: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was called damaged, or a file of another program."""
    path = ran.parent / "out" / "arm.h5"
    monkeypatch.setattr("os.access", lambda name, mode: Path(name) != path)
    for command in (("run", ran, "--quiet"), ("check", path.parent)):
        found = call(*command)
        assert found.exit_code == 2 and f"{path}: you have no permission to read" in found.stderr


def test_a_folder_that_may_not_be_written_is_refused_before_anything_is_computed(
    study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its stages may be in a folder that can be written: everything was computed, and then lost."""
    out = study.parent / "out"
    out.mkdir()
    monkeypatch.setattr("os.access", lambda name, mode: Path(name) != out or mode != os.W_OK)
    found = call("run", study, "--quiet")
    assert found.exit_code == 2 and "you have no permission to write in this folder; choose another" in found.stderr
    assert not (out / "stages").exists()


@pytest.mark.parametrize("name", ["arm.h5", "system.h5"])
def test_a_check_sees_results_that_are_gone(ran: Path, name: str) -> None:
    path = ran.parent / "out" / name
    path.unlink()
    found = call("check", path.parent)
    assert found.exit_code == 2 and f"{path}: the run wrote this file, and it is gone" in found.stderr


def test_component_files_are_no_runs_to_compare(ran: Path) -> None:
    found = call("diff", ran.parent / "out" / "arm.h5", ran.parent / "out" / "panel.h5")
    assert found.exit_code == 2 and "this is a component file, not a run" in found.stderr
    assert "`cmsreduce check FILE --baseline OTHER`" in found.stderr


def test_a_check_sees_files_of_other_programs_that_are_not_as_written(ran: Path) -> None:
    """They have no seal; the record of the run has their digests."""
    path = ran.parent / "out" / "panel.SID_FEM"
    assert call("run", ran, "--quiet", "--set", "write.formats=[hdf5, sid]").exit_code == 0
    assert call("check", path.parent).exit_code == 0
    text = path.read_bytes()
    for damage in (text[:-1], text.replace(b"1", b"2", 1), None):
        path.unlink() if damage is None else path.write_bytes(damage)
        found = call("check", path.parent)
        assert found.exit_code == 2 and found.stderr.startswith(f"error: {path}: the "), found.stderr
        assert "write it again with `cmsreduce run`" in found.stderr
    # A run that leaves the format out does not ask for its file.
    assert call("run", ran, "--quiet", "--set", "write.formats=[hdf5]").exit_code == 0
    assert call("check", path.parent).exit_code == 0


def test_a_run_replaces_its_own_files(study: Path) -> None:
    for _ in range(2):
        assert call("run", study, "--quiet", "--set", "write.formats=[hdf5, sid]").exit_code == 0


def test_an_input_is_not_replaced_by_a_result(study: Path) -> None:
    inputs = study.parent
    (inputs / "stages").mkdir()
    deck = inputs / "arm.op4"
    before = deck.read_bytes()
    found = call("run", study, "--quiet", "--out", inputs, "--set", "write.formats=[nastran]")
    assert found.exit_code == 2
    assert f"{deck}: this file is read by the run and would be replaced" in found.stderr
    assert deck.read_bytes() == before


def test_an_included_file_is_not_replaced_by_a_result(study: Path) -> None:
    """The result has the name of a file that a deck includes; an earlier run has made the folder its own."""
    inputs = study.parent
    deck, included = inputs / "arm.bdf", inputs / "panel.SID_FEM"
    grids = deck.read_text().replace("BEGIN BULK\n", "").replace("ENDDATA\n", "")
    included.write_text(grids)
    deck.write_text(f"BEGIN BULK\nINCLUDE '{included.name}'\nENDDATA\n")
    (inputs / "stages").mkdir()
    for again in range(2):
        found = call("run", study, "--quiet", "--out", inputs, "--set", "write.formats=[sid]")
        assert found.exit_code == 2, again
        assert f"{included}: this file is read by the run and would be replaced" in found.stderr
        assert included.read_text() == grids


def test_a_pipeline_in_json_is_not_taken_for_a_summary(study: Path) -> None:
    path = study.with_name("summary.json")
    path.write_text(json.dumps(YAML(typ="safe").load(study.read_text())))
    before = path.read_bytes()
    found = call("run", path, "--quiet", "--out", study.parent)
    assert found.exit_code == 2 and f"{path}: this file is read by the run" in found.stderr
    assert path.read_bytes() == before
    study.with_name("mine").mkdir()
    path.rename(other := study.with_name("mine") / "summary.json")
    found = call("run", study, "--quiet", "--out", other.parent)
    assert (
        found.exit_code == 2 and f"{other}: a file of this name is there that cmsreduce did not write" in found.stderr
    )


def test_a_foreign_file_of_a_run_directory_is_not_replaced(ran: Path) -> None:
    """Files without a mark are known by the record of the files that runs wrote."""
    out = ran.parent / "out"
    mine, log, passing = out / "panel.SID_FEM", out / "failures.log", out / "stages" / "arm.h5"
    for path in (mine, log, passing):
        path.write_text("mine")
        found = call("run", ran, "--quiet", "--set", "write.formats=[sid]")
        assert found.exit_code == 2, path
        assert f"{path}: a file of this name is there that cmsreduce did not write" in found.stderr
        assert path.read_text() == "mine"
        path.unlink()
    assert call("run", ran, "--quiet", "--set", "write.formats=[sid]").exit_code == 0
    assert call("run", ran, "--quiet", "--set", "write.formats=[sid]").exit_code == 0


def test_two_results_of_one_name_are_refused(study: Path) -> None:
    text = study.read_text().replace("arm", "system-0")
    study.write_text(text.replace("system-0.op4", "arm.op4").replace("system-0.bdf", "arm.bdf"))
    found = call("run", study, "--quiet", "--set", "write.formats=[fmi]")
    assert found.exit_code == 2 and "system-0.fmu: two results of this run would have this name" in found.stderr


def test_results_whose_names_differ_in_capitals_only_are_refused(study: Path) -> None:
    """On a disk that does not tell them apart, one body's file would be the other's."""
    text = study.read_text().replace("panel", "Arm")
    study.write_text(text.replace("Arm.op4", "panel.op4").replace("Arm.bdf", "panel.bdf"))
    found = call("run", study, "--quiet")
    assert found.exit_code == 2
    assert re.search(r"two results of this run would have this name \(\w+.h5 is another one on some", found.stderr)


def test_clearing_the_cache_leaves_foreign_files(ran: Path) -> None:
    out = ran.parent / "out"
    mine = out / "stages" / "mine.reduce.h5"
    with h5py.File(mine, "w") as file:
        file["mine"] = 1.0
    text = out / "stages" / "notes.tmp"
    text.write_text("mine")
    cleared = call("cache", "clear", out).stdout
    assert f"{mine} stays" in cleared and "removed 8 files" in cleared
    assert mine.is_file() and text.is_file()


def test_a_foreign_table_stops_a_sweep(study: Path) -> None:
    folder = study.parent / "out-sweep"
    folder.mkdir()
    (folder / "sweep.csv").write_text("mine")
    found = call("sweep", study, "--over", "reduce.cutoff=15", "--quiet")
    assert (
        found.exit_code == 2 and "sweep.csv: a file of this name is there that cmsreduce did not write" in found.stderr
    )


@pytest.mark.parametrize("option", ["--log-file", "--junit", "--markdown"])
def test_a_list_of_checks_or_a_log_does_not_replace_a_model(finished_study: Path, tmp_path: Path, option: str) -> None:
    out, limits = finished_study / "out", tmp_path / "limits.yaml"
    limits.write_text("max: {frf_error: 1.0}\n")
    mine = [finished_study / "study.yaml", finished_study / "arm.bdf", out / "arm.h5", out / "summary.json", limits]
    for path in mine:
        before = path.read_bytes()
        found = call("check", out, "--quiet", option, path)
        assert found.exit_code == 2 and f"{path}: this is " in found.stderr and "would be replaced" in found.stderr
        assert path.read_bytes() == before
    # What an earlier call wrote is replaced, and so is an empty file.
    earlier = tmp_path / "earlier"
    earlier.touch()
    for _ in range(2):
        assert call("check", out, option, earlier).exit_code == 0
    assert earlier.stat().st_size


def test_a_pipe_is_not_waited_for(good_study: Path, tmp_path: Path) -> None:
    pipe, including = tmp_path / "pipe", tmp_path / "deck.inp"
    os.mkfifo(pipe)
    including.write_text("*INCLUDE, INPUT=pipe\n*NODE\n1, 0, 0, 0\n")
    calls = [("run", pipe), ("inspect", pipe), ("inspect", including), ("check", good_study, "--limits", pipe)]
    calls += [("run", good_study / "study.yaml", "--cluster", pipe)]
    for arguments in calls:
        found = call(*arguments)
        assert found.exit_code == 2 and f"{pipe}: is a device or a pipe, not a file" in found.stderr, arguments


def test_an_empty_name_is_not_the_present_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a variable of the shell that is not set."""
    monkeypatch.chdir(tmp_path)
    calls = [("inspect", ""), ("run", "x.yaml", "--out", ""), ("cache", "clear", ""), ("convert", "x.h5", "")]
    for arguments in (*calls, ("new", "x", ""), ("check", "x", "--junit", "")):
        found = call(*arguments)
        assert found.exit_code == 2 and "the name is empty" in found.stderr, arguments
    assert not list(tmp_path.iterdir())
