"""Two runs on one directory: the second waits, and finds what the first has finished."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.store import sole_use
from tests.pipeline.study import Log
from tests.pipeline.test_reuse import done

# A process that begins as a copy of this one has the libraries, which take a second to load.
FORKING = get_context("fork")


def hold(folder: Path, told: Connection) -> None:
    """Use a folder alone until something is said."""
    with sole_use(folder, print):
        told.send("held")
        told.recv()


@contextmanager
def holder(folder: Path) -> Iterator[tuple[BaseProcess, Connection]]:
    """Another process that uses a folder alone."""
    here, there = FORKING.Pipe()
    process = FORKING.Process(target=hold, args=(folder, there))
    process.start()
    there.close()
    assert here.recv() == "held"
    try:
        yield process, here
    finally:
        process.kill()
        process.join()


def test_the_second_waits_until_the_first_is_through(tmp_path: Path) -> None:
    said: list[str] = []
    with holder(tmp_path) as (first, to_first):

        def let_go(text: str) -> None:
            said.append(text)
            assert first.is_alive()
            to_first.send("end")

        with sole_use(tmp_path, let_go):
            first.join(30)
            assert first.exitcode == 0
    assert len(said) == 1 and f"another run is at work in {tmp_path}" in said[0]
    assert list(tmp_path.iterdir()) == []


def test_a_killed_process_holds_nothing(tmp_path: Path) -> None:
    with holder(tmp_path) as (first, _):
        first.kill()
        first.join(30)
    said: list[str] = []
    with sole_use(tmp_path, said.append):
        assert said == []


def test_two_runs_at_once_do_each_stage_once(study: Path, opened: Callable[..., Run]) -> None:
    program = [sys.executable, "-m", "cmsreduce.cli", "run", str(study), "--verbose"]
    with subprocess.Popen(program, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as first:
        assert first.stderr is not None
        next(line for line in first.stderr if "reduce        arm" in line)
        run = opened()
        execute(run, study, report=False)
        assert isinstance(run.stages.progress, Log)
        assert run.stages.progress.done[0].startswith("wait another run is at work")
        assert first.wait(60) == 0
    assert done(run) == []


def test_a_run_says_at_once_that_it_waits(study: Path) -> None:
    """Also without --verbose, which tells notes at the end."""
    out = study.parent / "out"
    program = [sys.executable, "-m", "cmsreduce.cli", "run", str(study), "--until", "reduce"]
    with holder(out) as (_, to_first):
        with subprocess.Popen(program, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as second:
            assert second.stderr is not None
            assert f"another run is at work in {out}" in second.stderr.readline()
            assert second.poll() is None
            to_first.send("end")
            second.stderr.read()
        assert second.returncode == 0
