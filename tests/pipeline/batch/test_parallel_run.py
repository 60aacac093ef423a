"""A run in several processes writes what a run in one writes, also when they fail."""

from __future__ import annotations

import json
import os
from concurrent.futures import Executor, Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.linalg.blocks import symmetric_product
from cmsreduce.linalg.machine import SolverSettings, mkl_library, solver_settings
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.batch import opened_run
from cmsreduce.pipeline.batch.parallel_run import ParallelRun, _finish_body, _Opening
from cmsreduce.pipeline.batch.workers import Workers, local_workers
from cmsreduce.write.seal import SEAL
from tests.pipeline.rounding import assert_close
from tests.pipeline.study import Log
from tests.pipeline.test_reuse import untimed


def summary(folder: Path) -> Any:
    found = untimed(json.loads((folder / "summary.json").read_text()))
    for part in found["components"].values():
        del part["solver"]
    return found


@pytest.fixture(scope="module")
def alone(good_study: Path, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The study run in this process."""
    folder, path = tmp_path_factory.mktemp("alone"), good_study / "study.yaml"
    execute(Run(load_pipeline(path), folder, Log()), path, report=False)
    return summary(folder)


@pytest.mark.usefixtures("warm_processes")
def test_processes_find_the_same_as_one(alone: Any, good_study: Path, tmp_path: Path) -> None:
    path, log, taken = good_study / "study.yaml", Log(), tmp_path / "stages" / ".taken"
    # As a run leaves it that was killed.
    taken.mkdir(parents=True)
    (taken / "arm").touch()
    with opened_run(path, (), tmp_path, log, jobs=2) as run:
        assert isinstance(run, ParallelRun) and not taken.exists()
        # What the processes finished is not done again here.
        assert {name for name in run.reduced_names if (tmp_path / "stages" / f"{name}.orthogonalise.h5").is_file()} == {
            *run.reduced_names
        }
        execute(run, path, report=False)
    # Every body is proven by one process.
    assert not [entry for entry in log.done if entry.startswith("read ")]
    assert_close(alone, summary(tmp_path))
    with opened_run(path, (), tmp_path, Log(), jobs=2) as again:
        # Nothing is left for other processes.
        assert not isinstance(again, ParallelRun)


@pytest.mark.usefixtures("warm_processes")
def test_processes_write_the_files_of_the_bodies(
    good_study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, keys = good_study / "study.yaml", ("balance=null", "verify=null", "write.formats=[hdf5, sid]")
    alone = Run(load_pipeline(path, keys), tmp_path / "alone", Log())
    execute(alone, path, keys, report=False)
    with opened_run(path, keys, tmp_path / "both", Log(), jobs=2) as run:
        # This process writes none of them.
        monkeypatch.delitem(execute.__globals__, "write_body")
        execute(run, path, keys, report=False)
    own, other = (
        [file.relative_to(each.folder) for file in each.stages.written if file.parent == each.folder]
        for each in (alone, run)
    )
    assert other == own
    assert {file.stem for file in own} == {"arm", "panel", "system"}
    for file in own:
        first, second = alone.folder / file, run.folder / file
        if file.suffix != ".h5":
            assert first.read_bytes() == second.read_bytes()
            continue
        with h5py.File(first) as one, h5py.File(second) as two:
            assert one.attrs[SEAL] == two.attrs[SEAL]


class Dying(Executor):
    """Every process dies of its task."""

    def __init__(self) -> None:
        self.tasks: list[tuple[Any, ...]] = []

    def submit(self, work: Any, /, *arguments: Any, **named: Any) -> Future[Any]:
        self.tasks.append(arguments)
        future: Future[Any] = Future()
        future.set_exception(BrokenProcessPool())
        return future


def test_what_processes_do_not_finish_is_done_by_the_run(alone: Any, good_study: Path, tmp_path: Path) -> None:
    path = good_study / "study.yaml"
    workers = Workers(2, 1, None, lambda jobs: nullcontext(Dying()), (BrokenProcessPool,))
    run = ParallelRun(load_pipeline(path), tmp_path, Log(), workers, Dying())
    run.finish_bodies()
    execute(run, path, report=False)
    assert_close(alone, summary(tmp_path))


@pytest.mark.parametrize("longest", ["arm", "panel"])
def test_the_longest_work_begins_first(longest: str, study: Path, tmp_path: Path) -> None:
    with (study.parent / f"{longest}.bdf").open("a") as deck:
        deck.write("$\n" * 10**6)
    executor = Dying()
    workers = Workers(2, 1, None, lambda jobs: nullcontext(executor), (BrokenProcessPool,))
    ParallelRun(load_pipeline(study), tmp_path, Log(), workers, executor).finish_bodies()
    assert [first for *_, first, _, _ in executor.tasks] == [longest, *({"arm", "panel"} - {longest})]


def test_a_process_first_takes_a_body_whose_factor_it_has(good_study: Path, tmp_path: Path) -> None:
    pipeline, names = load_pipeline(good_study / "study.yaml"), ["arm", "panel"]
    # Another process has proven the arm, and none has taken it.
    Run(pipeline, tmp_path, Log())._proven("arm")
    opening = _Opening(pipeline, tmp_path, None)
    assert [_finish_body(opening, "arm", names, tmp_path) for _ in range(3)] == ["panel", "arm", None]


def test_results_that_cannot_be_shared_are_made_by_the_run(good_study: Path, tmp_path: Path) -> None:
    """Stages cannot be written: no process is asked, and the run says so where it writes."""
    (tmp_path / "stages").write_text("no folder")
    executor = Dying()
    workers = Workers(2, 1, None, lambda jobs: nullcontext(executor), (BrokenProcessPool,))
    ParallelRun(load_pipeline(good_study / "study.yaml"), tmp_path, Log(), workers, executor).finish_bodies()
    assert not executor.tasks


@pytest.mark.usefixtures("warm_processes")
def test_what_is_wrong_is_said_once_and_by_the_run(good_study: Path, tmp_path: Path) -> None:
    path, wrong = good_study / "study.yaml", ("balance.keep={modes: 500}",)
    said = "500 modes of 'arm'"
    with pytest.raises(CmsReduceError, match=said), opened_run(path, wrong, tmp_path, Log(), jobs=2) as run:
        execute(run, path, wrong, report=False)
    assert not (tmp_path / "summary.json").exists()


def entry_in_shared_memory() -> tuple[Path, bool]:
    """Entry of Intel's OpenMP in this process after a product in sparse algebra, and whether it is there."""
    A = sp.csc_array(sp.eye_array(20_000))
    # One thread alone leaves none.
    with solver_settings(SolverSettings(threads=2)):
        symmetric_product(A)(np.ones((20_000, 8)))
    entry = Path(f"/dev/shm/__KMP_REGISTERED_LIB_{os.getpid()}_{os.getuid()}")
    return entry, entry.exists()


@pytest.mark.skipif(mkl_library() is None, reason="MKL is not installed")
def test_processes_leave_nothing_in_shared_memory() -> None:
    workers = local_workers(2)
    with workers.start(1) as executor:
        entry, there = workers.submit(executor, entry_in_shared_memory).result()
    assert there and not entry.exists()
