"""The sweep and the cache on the command line: files, words, exit codes."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main

# Two angles would take longer, and show nothing more of files, words and exit codes.
ONE_ANGLE = ("--set", "scene.articulation={hinge: [50 deg]}")


def call(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.mark.usefixtures("warm_processes")
@pytest.mark.parametrize(
    ("args", "code", "statuses"),
    [
        (["--over", "reduce.cutoff=10,15"], 0, ["passed", "passed"]),
        (["--over", "verify.limits.frf_error=0.05,1e-12"], 1, ["passed", "limit broken"]),
        (["--over", "reduce.cutoff=15,-1"], 1, ["passed", "failed"]),
        (["--over", "balance.keep={modes: 500},all", "--jobs", "2"], 1, ["failed", "passed"]),
    ],
)
def test_exit_codes(study: Path, args: list[str], code: int, statuses: list[str]) -> None:
    out = study.parent / "swept"
    result = call("sweep", study, *args, *ONE_ANGLE, "--out", out)
    assert result.exit_code == code, result.output
    with (out / "sweep.csv").open(newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == statuses
    for name in ("sweep.csv", "sweep.h5", "sweep.svg", "sweep.html"):
        assert (out / name).is_file() and str(out / name) in result.stdout


@pytest.mark.parametrize(
    ("args", "said"),
    [
        (["--over", "reduce.cutof=1,2"], "error: --over reduce.cutof=1: key 'reduce.cutof' is unknown"),
        (["--over", "reduce.cutoff"], "error: --over reduce.cutoff: write KEY=V1,V2"),
        (["--over", "output=a,b"], "cannot be swept"),
        ([], "Missing option '--over'"),
        (["--over", "reduce.cutoff=1", "--jobs", "0"], "--jobs"),
    ],
)
def test_a_sweep_that_is_wrong_exits_2(study: Path, args: list[str], said: str) -> None:
    result = call("sweep", study, *args)
    assert result.exit_code == 2
    assert said in result.stderr and "Traceback" not in result.stderr
    assert not list(study.parent.glob("*-sweep"))


def test_a_sweep_goes_beside_the_run(study: Path) -> None:
    assert call("sweep", study, "--over", "reduce.cutoff=15", "--quiet").output == ""
    assert (study.parent / "out-sweep" / "points" / "cutoff=15" / "summary.json").is_file()


def test_the_cache_is_listed_and_cleared(ran: Path) -> None:
    out = ran.parent / "out"
    listed = call("cache", "ls", out)
    lines = listed.stdout.splitlines()
    assert listed.exit_code == 0 and lines[-1].startswith("8 finished stages")
    assert {tuple(line.split()[:2]) for line in lines[:-1]} >= {("reduce", "arm"), ("verify", "system")}
    assert call("cache", "clear", out).stdout.startswith("removed 8 files")
    assert call("cache", "ls", out).stdout.startswith("0 finished stages")
    assert (out / "summary.json").is_file()
    wrong = call("cache", "ls", ran.parent / "nowhere")
    assert wrong.exit_code == 2 and "no finished stages" in wrong.stderr


def test_diff_shows_what_differs_and_by_how_much(study: Path) -> None:
    folders = [study.parent / name for name in ("a", "b")]
    for folder, keep in zip(folders, ("all", "{modes: 4}"), strict=True):
        assert call(
            "run", study, "--quiet", "--out", folder, *ONE_ANGLE, "--set", f"balance.keep={keep}"
        ).exit_code in (0, 1)
    said = call("diff", *folders)
    assert said.exit_code == 0
    rows = {line.rpartition(": ")[2].split()[0]: line.split() for line in said.stdout.splitlines() if "panel: " in line}
    # 13 elastic modes of the panel below the cutoff, and 4 of them: 9 of 13 fewer.
    assert rows["kept_modes"][-4:] == ["13", "4", "-69.2", "%"]
    assert "full_dofs" not in said.stdout
    none = call("diff", folders[0], folders[0])
    assert none.exit_code == 0 and none.stdout.startswith("0 figures differ, ")
    wrong = call("diff", folders[0], study.parent)
    assert wrong.exit_code == 2 and "no summary.json" in wrong.stderr
