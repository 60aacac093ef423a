"""Output of every command on the terminal, as JSON, quietly, and into a log."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from tests.sealed import resealed_summary


def call(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, good_study: Path) -> Path:
    folder = tmp_path_factory.mktemp("output")
    shutil.copytree(good_study, folder / "study", ignore=lambda *_: ["finished", "out"])
    out = folder / "out"
    assert call("run", folder / "study" / "study.yaml", "--quiet", "--out", out).exit_code == 0
    return out


def study_of(finished: Path) -> Path:
    return finished.parent / "study" / "study.yaml"


def test_the_last_line_says_what_was_made_the_worst_error_and_the_time(finished: Path) -> None:
    said = call("run", study_of(finished), "--out", finished)
    facts = json.loads((finished / "summary.json").read_text())
    lines = said.stdout.splitlines()
    made = rf"study: PASS; 5 files in {re.escape(str(finished))}"
    last = re.fullmatch(rf"{made}; worst response error ([\d.]+) % at (.+); ([\d.]+) s", lines[-1])
    assert last, lines[-1]
    assert float(last[1]) == pytest.approx(100 * facts["worst"]["frf_error"], rel=5e-3)
    assert last[2] == facts["figures"]["frf_error"]["where"] and float(last[3]) > 0
    assert lines[-2] == str(finished / "report.html")
    names = ("summary.json", "report.html", "arm.h5", "panel.h5", "system.h5")
    every = call("run", study_of(finished), "--out", finished, "--verbose").stdout.splitlines()
    assert [line for line in every if line.startswith(str(finished))][:5] == [str(finished / name) for name in names]


def test_run_as_json_is_the_summary_and_nothing_else(finished: Path) -> None:
    said = call("run", study_of(finished), "--out", finished, "--json", "--verbose")
    found = json.loads(said.stdout)
    stored = json.loads((finished / "summary.json").read_text())
    assert {key: found[key] for key in ("figures", "limits", "worst", "passed")} == {
        key: stored[key] for key in ("figures", "limits", "worst", "passed")
    }
    assert set(found) - set(stored) == {"folder", "files", "seconds"}
    assert {Path(file).name for file in found["files"]} == {
        "summary.json", "report.html", "arm.h5", "panel.h5", "system.h5"
    }  # fmt: skip
    assert "verify        system" in said.stderr
    assert call("run", study_of(finished), "--out", finished, "--json", "--quiet").stderr == ""


def test_a_stage_as_json_names_what_it_wrote(finished: Path) -> None:
    out = finished.parent / "part"
    said = call("run", study_of(finished), "--until", "orthogonalise", "--out", out, "--json")
    found = json.loads(said.stdout)
    assert found["written"] and all(Path(path).is_file() for path in found["written"])
    words = call("run", study_of(finished), "--until", "orthogonalise", "--out", finished.parent / "again").stdout
    assert re.fullmatch(r"\d+ files in [\d.]+ s", words.splitlines()[-1])


@pytest.mark.parametrize(("limit", "code"), [("frf_error=0.5", 0), ("arm.kept_modes=1", 1), ("peak_error=1e-9", 1)])
def test_check_as_json_and_quietly(finished: Path, limit: str, code: int) -> None:
    said, quiet = (call("check", finished, "--max", limit, option) for option in ("--json", "--quiet"))
    assert said.exit_code == quiet.exit_code == code
    found = json.loads(said.stdout)
    assert found["passed"] is (code == 0)
    failed = [each for each in found["findings"] if each["verdict"] == "fail"]
    assert found["failed"] == len(failed) == len(quiet.stdout.splitlines())
    assert found["judged"] == sum(each["limit"] is not None for each in found["findings"])
    assert all(line.startswith("FAIL  ") for line in quiet.stdout.splitlines())
    names = {(each["of"], each["figure"]) for each in found["findings"]}
    for figure in ("peak_error", "frac_error", "nrfd", "static_lack", "gain_error", "zero_error", "zeros_lost"):
        assert (None, figure) in names


def test_inspect_as_json(finished: Path) -> None:
    folder = study_of(finished).parent
    files = [folder / "arm.op4", folder / "panel.bdf", finished / "panel.h5", folder / "study.yaml", finished]
    found = json.loads(call("inspect", *files, "--json").stdout)
    assert [each["kind"] for each in found] == ["matrices", "geometry", "component", "pipeline", "run"]
    assert [(m["name"], m["rows"]) for m in found[0]["matrices"]] == [("KAA", 30), ("MAA", 30)]
    assert found[1]["nodes"] == 6
    assert len(found[2]["frequencies_hz"]) == 13
    arm = found[3]["bodies"]["arm"]
    # Four bars of 0.2 m, 4 cm2, 2700 kg/m3 and a lump of 0.3 kg in the middle.
    assert arm["health"]["mass_properties"]["geometry"]["mass"] == pytest.approx([1.164] * 3)
    assert arm["health"]["mass_properties"]["stiffness"]["centre"] == pytest.approx([0.4, 0, 0], abs=1e-9)
    assert arm["health"]["rigid_motions"]["first_elastic_hz"] > 1
    assert all(check["passed"] for check in arm["checks"]) and found[3]["bodies"]["hub"]["mass"] == 5.0
    assert found[4]["components"]["arm"]["static_lack"][0]["load"] == "interface 'root'"


def test_convert_and_diff_as_json(finished: Path, tmp_path: Path) -> None:
    made = call("convert", finished / "arm.h5", tmp_path / "arm.mat", "--json")
    if made.exit_code == 2:
        made = call("convert", finished / "arm.h5", tmp_path / "arm.SID_FEM", "--json")
    assert made.exit_code == 0, made.output
    assert all(Path(path).is_file() for path in json.loads(made.stdout)["written"])
    quiet = call("convert", finished / "arm.h5", tmp_path / "again.SID_FEM", "--quiet")
    assert (quiet.exit_code, quiet.output) == (0, "")
    same = json.loads(call("diff", finished, finished, "--json").stdout)
    assert same["differing"] == [] and same["same"] > 10
    runs = []
    for word in ("FAIL", "not checked"):
        runs.append(tmp_path / f"{word}.json")
        with resealed_summary(finished / "summary.json", runs[-1]) as facts:
            facts["passed"], facts["verdict"]["word"] = False, word
    (row,) = json.loads(call("diff", *runs, "--json").stdout)["differing"]
    assert row == {"what": "verdict", "a": "FAIL", "b": "not checked", "change": None}


def test_sweep_as_json(finished: Path) -> None:
    out = finished.parent / "sweep"
    said = call("sweep", study_of(finished), "--over", "reduce.cutoff=4,15", "--out", out, "--json", "--quiet")
    found = json.loads(said.stdout)
    assert said.stderr == "" and said.exit_code == (0 if found["passed"] else 1)
    assert [point["overrides"] for point in found["points"]] == [
        {"reduce.cutoff": "4"},
        {"reduce.cutoff": "15"},
    ]
    assert found["points"][0]["frf_error"] > found["points"][1]["frf_error"] and found["points"][1]["pareto"]
    assert all(Path(file).is_file() for file in found["files"])


def test_a_log_holds_progress_and_result(finished: Path, tmp_path: Path) -> None:
    log = tmp_path / "deep" / "run.log"
    said = call("run", study_of(finished), "--out", finished, "--quiet", "--log-file", log)
    assert (said.exit_code, said.output) == (0, "")
    text = log.read_text()
    assert "finished before, reused" in text and "study: PASS; 5 files in" in text.splitlines()[-1]
    assert "\x1b" not in text
    call("check", finished, "--log-file", log, "--quiet")
    assert log.read_text().splitlines()[-1].startswith("all ")


def test_a_log_holds_the_error_that_ended_it(tmp_path: Path) -> None:
    log = tmp_path / "run.log"
    said = call("run", tmp_path / "none.yaml", "--log-file", log)
    assert said.exit_code == 2 and log.read_text() == said.stderr
    nowhere = call("run", tmp_path / "none.yaml", "--log-file", log / "below.log")
    assert nowhere.exit_code == 2 and "the log cannot be written" in nowhere.stderr


def test_a_limit_on_a_check_fails_the_run(finished: Path) -> None:
    limits = "{peak_error: 1e-9, zero_error: 1e-12}"
    said = call("run", study_of(finished), "--out", finished.parent / "strict", "--set", f"verify.limits={limits}")
    assert said.exit_code == 1
    text = " ".join(said.stdout.split())
    assert "FAIL peak height" in text and "is above its limit 1e-07 %" in text
    bad = call("run", study_of(finished), "--set", "verify.checks=[statics]")
    assert bad.exit_code == 2 and "verify.checks" in bad.stderr and "did you mean 'static'" in bad.stderr
