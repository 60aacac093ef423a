"""A run killed at any moment leaves no half file, and the next run goes on from the last finished stage."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, execute
from tests.pipeline import killed
from tests.pipeline.rounding import assert_close, assert_files_close
from tests.pipeline.study import RIGID_PANEL, Log, write_study
from tests.pipeline.test_reuse import done, untimed

STAGES = ["arm.read", "panel.read", "panel.reduce", "panel.orthogonalise", "arm.reduce", "arm.orthogonalise"]
STAGES += ["system.balance", "system.verify"]


@pytest.fixture(scope="module")
def runs() -> Iterator[subprocess.Popen[str]]:
    """A process that has loaded the libraries and forks off runs to kill."""
    program = [sys.executable, killed.__file__]
    with subprocess.Popen(program, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.stdin.close()


def same_results(folder: Path, other: Path) -> None:
    names = sorted(path.name for path in other.glob("*.h5"))
    assert {"arm.h5", "system.h5"} <= {*names} == {path.name for path in folder.glob("*.h5")}
    for name in names:
        assert_files_close(folder / name, other / name)
    one, two = (untimed(json.loads((out / "summary.json").read_text())) for out in (folder, other))
    assert_close(one, two)


def test_killed_at_every_file(tmp_path: Path) -> None:
    """The first run dies at its first file, later ones at the one after, as the file before it is finished by then.

    One body is flexible: the files of a second one are of the same kinds.
    """
    folders = [tmp_path / name for name in ("killed", "whole")]
    for folder in folders:
        folder.mkdir()
    # One angle: what is done again in each run is cheaper.
    text = RIGID_PANEL.replace("hinge: [0, 50 deg]", "hinge: [50 deg]")
    study, whole = (write_study(folder, text) for folder in folders)
    execute(Run(load_pipeline(whole), whole.parent / "out", Log()), whole)
    results = [
        "stages/written.json",
        "stages/origin.json",
        "summary.json",
        "report.html",
        "arm.h5",
        "system.h5",
    ]
    stages = [f"stages/{stage}.h5" for stage in STAGES if not stage.startswith("panel")]
    moments = [1] + [2] * len(stages) + [*range(2, len(results) + 1), 0]
    program = [sys.executable, killed.__file__, str(study), *map(str, moments)]
    said = subprocess.run(program, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    runs = [json.loads(line) for line in said.stdout.splitlines()]
    order = [*stages, *results]
    assert [run["status"] for run in runs] == [-signal.SIGKILL] * len(order) + [0]
    for number, run in enumerate(runs[:-1]):
        assert sorted(run["whole"]) == sorted(order[:number])
        (temporary,) = run["temporary"]
        folder, _, name = order[number].rpartition("/")
        assert temporary.startswith(f"{folder}/.{name}." if folder else f".{name}.")
    assert sorted(runs[-1]["whole"]) == sorted(order)
    assert runs[-1]["temporary"] == []
    same_results(study.parent / "out", whole.parent / "out")


@pytest.mark.parametrize(
    ("moment", "finished"),
    [
        ("read          arm", 0),
        ("reduce        arm", 4),
        ("balance       system", 6),
        ("verify        system", 7),
        ("write         component", 8),
    ],
)
def test_killed_when_a_stage_begins(
    runs: subprocess.Popen[str],
    study: Path,
    finished_study: Path,
    opened: Callable[..., Run],
    moment: str,
    finished: int,
) -> None:
    there = stages_left(runs, moment, study, "--set", "solver.threads=1")
    # The stage that had just begun may have come to its end before the signal did.
    assert there == STAGES[: len(there)] and len(there) >= finished
    goes_on(there, study, finished_study, opened("solver.threads=1"))


@pytest.mark.parametrize("moment", ["reduce        panel", "orthogonalise arm", "balance       system"])
def test_killed_while_two_bodies_are_at_work(
    runs: subprocess.Popen[str], study: Path, finished_study: Path, opened: Callable[..., Run], moment: str
) -> None:
    there = stages_left(runs, moment, study)
    assert {"arm.read", "panel.read"} <= {*there}
    goes_on(there, study, finished_study, opened())


def stages_left(runs: subprocess.Popen[str], moment: str, study: Path, *options: str) -> list[str]:
    """Stages that are finished when a run is killed as it tells of a moment."""
    assert runs.stdin is not None and runs.stdout is not None
    runs.stdin.write(json.dumps([moment, str(study), *options]) + "\n")
    runs.stdin.flush()
    assert int(runs.stdout.readline()) == -signal.SIGKILL
    out = study.parent / "out"
    left = killed.left_behind(out) if out.is_dir() else {"whole": []}
    return [stage for stage in STAGES if f"stages/{stage}.h5" in left["whole"]]


def goes_on(there: list[str], study: Path, finished_study: Path, run: Run) -> None:
    """Check that a run does what is not finished, and ends as one that was never killed."""
    out = study.parent / "out"
    execute(run, study, report=False)
    stages = [f"{name.split('.')[1]} {name.split('.')[0]}" for name in STAGES if name not in there]
    assert sorted(done(run)) == sorted(stage for stage in stages if not stage.startswith("read"))
    assert killed.left_behind(out)["temporary"] == [] == list(out.rglob("*.lock"))
    same_results(out, finished_study / "out")
