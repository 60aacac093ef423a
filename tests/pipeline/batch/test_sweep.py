"""A sweep finds at each point what a run with the same keys finds, alone, in processes, and after a kill."""

from __future__ import annotations

import json
import multiprocessing
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.model import SweepResult
from cmsreduce.pipeline import Run, execute, reopen, run_result
from cmsreduce.pipeline.batch import sweep, sweep_axes
from cmsreduce.pipeline.batch.sweep_points import sweep_points
from cmsreduce.pipeline.batch.workers import Workers
from cmsreduce.pipeline.store import cache_entries, clear_cache
from tests.pipeline.rounding import assert_close
from tests.pipeline.study import Log, panel, write_body
from tests.pipeline.test_reuse import untimed

# Two angles would take twice the time and show nothing more of what points and processes do.
ONE_ANGLE = "scene.articulation={hinge: [50 deg]}"
METHODS = "reduce.method=craig-bampton,macneal-rubin"
OVER = [METHODS, "balance.keep={modes: 4},{modes: 999},all", ONE_ANGLE]
# For what happens to processes, as many points as are under way with two of them, and as many to come.
FEW = [METHODS, "reduce.cutoff=10,15", ONE_ANGLE]
TIMES = ("reduce_s", "full_frf_s", "reduced_frf_s", "point_s")


def found(result: SweepResult) -> list[dict[str, object]]:
    """Rows without what differs from one time to the next."""
    return [{key: value for key, value in asdict(row).items() if key not in TIMES} for row in result.rows]


@pytest.fixture(scope="module")
def swept(good_study: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[SweepResult, Path]:
    """The study swept in this process."""
    return sweep(good_study / "study.yaml", sweep_axes(OVER), (), tmp_path_factory.mktemp("swept"))


@pytest.fixture(scope="module")
def few_swept(good_study: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[SweepResult, Path]:
    """Both methods at two cutoffs, swept in this process."""
    return sweep(good_study / "study.yaml", sweep_axes(FEW), (), tmp_path_factory.mktemp("few"))


@pytest.fixture(scope="module")
def few(few_swept: tuple[SweepResult, Path]) -> SweepResult:
    return few_swept[0]


def test_each_point_is_a_run(swept: tuple[SweepResult, Path], good_study: Path, tmp_path: Path) -> None:
    result, folder = swept
    assert [row.status == "failed" for row in result.rows] == [False, True, False] * 2
    for row in (result.rows[0], result.rows[5]):
        overrides = [f"{key}={value}" for key, value in row.overrides.items()]
        out = tmp_path / str(row.point)
        path = good_study / "study.yaml"
        execute(Run(load_pipeline(path, overrides), out, Log()), path, report=False)
        alone, here = (json.loads((at / "summary.json").read_text()) for at in (out, folder / row.folder))
        for summary in (alone, here):
            for part in summary["components"].values():
                # A body that another point has read is not factorised again for being read.
                del part["solver"]
        assert_close(untimed(alone), untimed(here))
        assert row.frf_error == here["worst"]["frf_error"]
        assert row.kept_modes == sum(part["kept_modes"] for part in here["components"].values())
        assert (row.status == "passed") == here["passed"]
        assert (folder / row.folder / "arm.h5").is_file()


def test_a_point_that_fails_has_its_reason_and_no_result(swept: tuple[SweepResult, Path]) -> None:
    result, folder = swept
    row = result.rows[1]
    assert "999 modes" in row.message and "elastic modes below the cutoff" in row.message
    assert not (folder / row.folder / "summary.json").exists()


def test_a_point_that_became_bad_input_keeps_no_result(good_study: Path, tmp_path: Path) -> None:
    """A value that an earlier sweep could run, before the pipeline or the program changed."""
    axes = sweep_axes(["balance.keep={modes: 4},{modes: -4}", ONE_ANGLE])
    stale = [
        tmp_path / "points" / point.folder / "summary.json" for point in sweep_points(good_study / "study.yaml", axes)
    ]
    for summary in stale:
        summary.parent.mkdir(parents=True)
        summary.write_text("{}")
    result, _ = sweep(good_study / "study.yaml", axes, (), tmp_path)
    assert [row.status == "failed" for row in result.rows] == [False, True]
    assert [summary.exists() for summary in stale] == [True, False]


@pytest.mark.parametrize(
    ("points", "reductions"),
    # Whatever is kept, and however many points: the bodies of two methods, and of two methods at two cutoffs.
    [("swept", 2), ("few_swept", 4)],
)
def test_what_points_share_is_there_once(points: str, reductions: int, request: pytest.FixtureRequest) -> None:
    _, folder = request.getfixturevalue(points)
    entries = cache_entries(folder)
    shared = [(entry.stage, entry.what) for entry in entries if entry.path.parent == folder / "stages"]
    for body in ("arm", "panel"):
        assert shared.count(("reduce", body)) == shared.count(("orthogonalise", body)) == reductions
        alone = ("read", body), ("reference", body), ("reference", f"{body}.static")
        assert [shared.count(each) for each in alone] == [1, 1, 1]
    assert len(shared) == 2 * (2 * reductions + 3)
    assert sum(entry.stage == "verify" for entry in entries) == 4


def test_a_point_can_be_opened_again(swept: tuple[SweepResult, Path]) -> None:
    result, folder = swept
    row = result.rows[2]
    again = run_result(reopen(folder / row.folder))
    assert again.worst()["frf_error"] == row.frf_error


@pytest.mark.usefixtures("warm_processes")
def test_processes_find_the_same_as_one(swept: tuple[SweepResult, Path], good_study: Path, tmp_path: Path) -> None:
    result, _ = sweep(good_study / "study.yaml", sweep_axes(OVER), (), tmp_path, jobs=2)
    assert_close(found(result), found(swept[0]))


class Inline(Executor):
    """Runs a task when it is submitted."""

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(work(*arguments))
        return future


@pytest.fixture
def inline(monkeypatch: pytest.MonkeyPatch) -> Callable[[float | None], list[int]]:
    """Let sweeps run their tasks here, with some bytes for a factor; the list grows with each start of processes."""

    def make(memory: float | None) -> list[int]:
        sizes: list[int] = []

        def start(jobs: int) -> AbstractContextManager[Executor]:
            sizes.append(jobs)
            return nullcontext(Inline())

        workers = Workers(2, 0, memory, start, (BrokenProcessPool,))
        module = import_module("cmsreduce.pipeline.batch.sweep")
        monkeypatch.setattr(module, "chosen_workers", lambda *named: nullcontext(workers))
        return sizes

    return make


def test_processes_that_outlive_a_sweep_read_its_files_anew(
    study: Path, tmp_path: Path, inline: Callable[..., list[int]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As those of a Dask scheduler that stays up."""
    axes = sweep_axes(["reduce.cutoff=10,15", ONE_ANGLE])
    inline(None)
    before, _ = sweep(study, axes, (), tmp_path / "swept", jobs=2)
    write_body(study.parent, replace(panel(), M=2 * panel().M))
    after, _ = sweep(study, axes, (), tmp_path / "swept", jobs=2)
    monkeypatch.undo()
    alone, _ = sweep(study, axes, (), tmp_path / "alone")
    assert_close(found(after), found(alone))
    assert abs(after.rows[0].frf_error / before.rows[0].frf_error - 1) > 0.01


def test_what_needs_more_than_its_share_of_the_memory_is_run_alone(
    few: SweepResult, good_study: Path, tmp_path: Path, inline: Callable[..., list[int]]
) -> None:
    # No factor fits into one byte.
    sizes = inline(1.0)
    result, _ = sweep(good_study / "study.yaml", sweep_axes(FEW), (), tmp_path, jobs=2)
    assert_close(found(result), found(few))
    assert sizes == [2, 2, 1]


def test_a_killed_process_loses_nothing(few: SweepResult, good_study: Path, tmp_path: Path) -> None:
    killed: list[int] = []
    # Those that other tests share live on.
    others = {child.pid for child in multiprocessing.active_children()}

    def kill_one() -> None:
        while not killed:
            children = [child for child in multiprocessing.active_children() if child.pid not in others]
            if children and any(tmp_path.glob("points/*/summary.json")):
                children[0].kill()
                killed.append(1)
            time.sleep(0.02)

    killer = threading.Thread(target=kill_one, daemon=True)
    killer.start()
    result, _ = sweep(good_study / "study.yaml", sweep_axes(FEW), (), tmp_path, jobs=2)
    assert killed
    assert_close(found(result), found(few))


def test_the_processes_of_a_killed_sweep_end_and_the_next_one_goes_on(
    few: SweepResult, good_study: Path, tmp_path: Path
) -> None:
    over = [word for text in FEW for word in ("--over", text)]
    program = [sys.executable, "-m", "cmsreduce.cli", "sweep", str(good_study / "study.yaml"), *over, "--jobs", "2"]
    with subprocess.Popen([*program, "--out", str(tmp_path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as killed:
        while killed.poll() is None and not any(tmp_path.glob("points/*/summary.json")):
            time.sleep(0.02)
        killed.kill()
        # Its processes have inherited the pipe: it ends when they do.
        assert killed.stdout is not None and select.select([killed.stdout], [], [], 30)[0]
        assert killed.stdout.read() == b""
    result, _ = sweep(good_study / "study.yaml", sweep_axes(FEW), (), tmp_path)
    assert_close(found(result), found(few))


# A job in the background of a shell, such as the tests may be, ignores Ctrl-C, and so does what it starts.
HEEDING = ("env", "--default-signal=INT")


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="children are found in /proc")
def test_ctrl_c_while_processes_load_is_one_line(good_study: Path, tmp_path: Path) -> None:
    """A terminal interrupts all processes of a command; the one that loads libraries for the others says nothing."""
    program = [*HEEDING, sys.executable, "-m", "cmsreduce.cli", "sweep", str(good_study / "study.yaml")]
    with subprocess.Popen(
        [*program, "--over", FEW[0], "--jobs", "2", "--quiet", "--out", str(tmp_path)],
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as stopped:  # fmt: skip
        children = Path(f"/proc/{stopped.pid}/task/{stopped.pid}/children")
        while not any(_loading(child) for child in children.read_text().split()):
            assert stopped.poll() is None
            time.sleep(0.01)
        os.killpg(stopped.pid, signal.SIGINT)
        said = stopped.communicate(timeout=60)[1]
    # Python may end by the signal itself: a shell shows 130 for both.
    assert stopped.returncode in (130, -signal.SIGINT)
    assert said == "interrupted; finished stages are kept and reused by the next run\n"


def _loading(process: str) -> bool:
    """Say whether it is the process that loads libraries for others, and has begun to."""
    about = Path("/proc") / process
    try:
        return b"forkserver" in (about / "cmdline").read_bytes() and b"numpy" in (about / "maps").read_bytes()
    except (FileNotFoundError, ProcessLookupError):
        return False


INTERRUPTED = """
import os, signal, time
from concurrent.futures.process import BrokenProcessPool
from cmsreduce.pipeline.batch.workers import local_workers
with local_workers(2).start(2) as executor:
    os.kill(executor.submit(os.getpid).result(), signal.SIGINT)
    try:
        for _ in range(1000):
            executor.submit(os.getpid).result()
            time.sleep(0.01)
    except BrokenProcessPool:
        print("ended")
"""


def test_ctrl_c_ends_a_waiting_process_without_a_word() -> None:
    program = [*HEEDING, sys.executable, "-c", INTERRUPTED]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("ended\n", "")


def test_a_damaged_shared_stage_is_made_again(good_study: Path, tmp_path: Path) -> None:
    axes = sweep_axes(["reduce.cutoff=10,15"])
    first, _ = sweep(good_study / "study.yaml", axes, (), tmp_path)
    for path in sorted((tmp_path / "stages").glob("arm.*.h5")):
        path.write_bytes(path.read_bytes()[:-100])
    for path in tmp_path.glob("points/*/stages/system.verify.h5"):
        path.unlink()
    again, _ = sweep(good_study / "study.yaml", axes, (), tmp_path)
    assert all("is damaged and is made again" in row.message for row in again.rows)
    assert_close(found(replace(again, rows=tuple(replace(row, message="") for row in again.rows))), found(first))


def test_clearing_leaves_results(good_study: Path, tmp_path: Path) -> None:
    sweep(good_study / "study.yaml", sweep_axes(["reduce.cutoff=10"]), (), tmp_path)
    entries = cache_entries(tmp_path)
    assert {entry.stage for entry in entries} == {"read", "reduce", "orthogonalise", "reference", "balance", "verify"}
    assert all(len(entry.key) == 12 for entry in entries)
    cleared = clear_cache(tmp_path)
    assert cleared[:2] == (len(entries), sum(entry.size for entry in entries))
    assert cache_entries(tmp_path) == []
    assert (tmp_path / "points" / "cutoff=10" / "summary.json").is_file()
