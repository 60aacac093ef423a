"""Bodies that are worked on at once give what they give one after the other."""

from __future__ import annotations

import _thread
import json
import signal
from collections.abc import Callable
from pathlib import Path
from threading import Barrier, Event
from typing import Any

import pytest

from cmsreduce.errors import ReadError
from cmsreduce.linalg.machine import current_settings
from cmsreduce.multifrontal.threads import _libraries
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.run import reading
from cmsreduce.pipeline.store import Stages, at_once, collecting, diagnostic
from tests.pipeline.study import Log

CORES = "cmsreduce.linalg.machine.settings.usable_cores"
# Seconds after which a test that waits for another thread fails.
PATIENCE = 60


@diagnostic("the portrait of '{}'", about=lambda name: name)
def portrait(name: str) -> None:
    raise ValueError(f"{name} moved")


def test_results_and_failures_come_in_the_order_of_the_bodies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CORES, lambda: 4)
    stages, second_is_done, threads = Stages(tmp_path, Log()), Event(), []

    def work(name: str) -> str:
        if name == "arm":
            assert second_is_done.wait(PATIENCE)
        portrait(name)
        with stages.timed("reduce", name):
            threads.append(current_settings().thread_count)
        if name == "panel":
            second_is_done.set()
        return name.upper()

    with collecting(stages.failures) as failed:
        assert at_once(stages, work, ("arm", "panel"), 2) == ["ARM", "PANEL"]
    assert [each.what for each in failed] == ["the portrait of 'arm'", "the portrait of 'panel'"]
    # Each has its share of the cores.
    assert threads == [2, 2]


def test_dense_algebra_of_bodies_at_once_takes_their_share(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CORES, lambda: 2)
    libraries = _libraries()
    # What the end of any block in this thread does.
    before = [library.get_num_threads() for library in libraries]
    for library in libraries:
        library.set_num_threads(2)
    try:
        stages = Stages(tmp_path, Log())
        found = at_once(stages, lambda _: [each.get_num_threads() for each in libraries], ("arm", "panel"), 2)
    finally:
        for library, count in zip(libraries, before, strict=True):
            library.set_num_threads(count)
    assert found == [[1] * len(libraries)] * 2


def test_the_error_of_the_first_body_counts(tmp_path: Path) -> None:
    stages, second_is_done = Stages(tmp_path, Log()), Event()

    def work(name: str) -> None:
        if name == "panel":
            second_is_done.set()
        else:
            assert second_is_done.wait(PATIENCE)
        raise ReadError(f"{name}.op4: no matrix")

    with pytest.raises(ReadError, match=r"arm\.op4"):
        at_once(stages, work, ("arm", "panel"), 2)


def test_an_interrupted_run_begins_nothing_more(tmp_path: Path) -> None:
    stages, begun = Stages(tmp_path, Log()), []

    def work(name: str) -> None:
        if name == "arm":
            _thread.interrupt_main()
        for _ in range(100 * PATIENCE):
            with stages.timed("reduce", name):
                begun.append(name)
            Event().wait(0.01)

    # Tests in the background ignore the signal. A library for clusters, once it is loaded, makes an exit of it.
    before = signal.getsignal(signal.SIGINT)
    if before is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises((KeyboardInterrupt, SystemExit)):
            at_once(stages, work, ("arm", "panel"), 2)
    finally:
        signal.signal(signal.SIGINT, before)
    assert stages.interrupted and len(begun) < 100 * PATIENCE


def test_bodies_of_a_run_are_read_at_once(opened: Callable[..., Run], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CORES, lambda: 2)
    both, proven = Barrier(2, timeout=PATIENCE), reading.proven_body

    def met(*given: Any) -> Any:
        both.wait()
        return proven(*given)

    monkeypatch.setattr(reading, "proven_body", met)
    run = opened()
    run.read_bodies()
    assert list(run.bodies) == ["arm", "panel"]


@pytest.mark.parametrize("alone", ["solver={threads: 1}", "memory", "size"])
def test_large_bodies_are_read_one_after_the_other(
    opened: Callable[..., Run], monkeypatch: pytest.MonkeyPatch, alone: str
) -> None:
    monkeypatch.setattr(CORES, lambda: 2)
    if alone == "memory":
        monkeypatch.setattr(reading, "available_memory", lambda: 1e4)
    if alone == "size":
        monkeypatch.setattr(reading, "_LARGE", 1e3)
    monkeypatch.setattr(reading, "at_once", lambda *given: pytest.fail("at once"))
    run = opened(*[each for each in [alone] if "=" in each])
    run.read_bodies()
    run.reduce_bodies(orthonormal=True)
    assert list(run.bodies) == ["arm", "panel"]


def test_a_run_says_the_same_on_one_core_and_on_two(study: Path, opened: Callable[..., Run]) -> None:
    summaries, told = [], []
    for cores in (1, 2):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(CORES, lambda cores=cores: cores)
            run = opened(
                f"output={study.parent}/out{cores}", "reduce={method: macneal-rubin, cutoff: 1, residuals: []}"
            )
            execute(run, study)
        summaries.append(json.loads((run.folder / "summary.json").read_text()))
        told.append(run.stages.progress.notes)
    one, two = summaries
    assert told[0] and told[0] == told[1]
    assert (one["notes"], one["verdict"]) == (two["notes"], two["verdict"])
    assert one["worst"]["frf_error"] == pytest.approx(two["worst"]["frf_error"], rel=1e-6)
    assert one["components"].keys() == two["components"].keys()
