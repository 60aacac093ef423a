"""Settings hold within their block, also if an error ends it; threads never exceed the usable cores."""

import os
from contextvars import copy_context

import pytest

from cmsreduce.linalg.machine import SolverSettings, available_memory, current_settings, solver_settings
from cmsreduce.linalg.machine import settings as module


def test_settings_nest():
    outer, inner = SolverSettings("superlu", threads=1), SolverSettings("pardiso", memory=1e9)
    assert current_settings() == SolverSettings()
    with solver_settings(outer) as given:
        assert given is outer
        assert current_settings() is outer
        with solver_settings(inner):
            assert current_settings() is inner
        assert current_settings() is outer
    assert current_settings() == SolverSettings()


def test_settings_end_with_an_error_in_the_block():
    with pytest.raises(ZeroDivisionError), solver_settings(SolverSettings("superlu")):
        raise ZeroDivisionError
    assert current_settings().backend == "auto"


def test_settings_of_one_context_are_not_those_of_another():
    with solver_settings(SolverSettings("superlu")):
        inside = copy_context()
    assert inside.run(current_settings).backend == "superlu"
    assert current_settings().backend == "auto"


@pytest.mark.parametrize(
    "threads, allowed, cores, expected",
    [
        (None, None, 8, 8),
        (None, "2", 8, 2),
        (None, "16", 8, 8),
        (None, "0", 8, 8),
        (None, "", 8, 8),
        (None, "4,2", 8, 8),
        (3, "1", 8, 3),
        (3, None, 1, 3),
    ],
)
def test_threads(monkeypatch, threads, allowed, cores, expected):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(cores)), raising=False)
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    if allowed is not None:
        monkeypatch.setenv("OMP_NUM_THREADS", allowed)
    assert SolverSettings(threads=threads).thread_count == expected


@pytest.mark.parametrize("memory, expected", [(None, 0.9 * 5e9), (2e9, 2e9)], ids=["most of what is free", "as given"])
def test_memory_limit(monkeypatch, memory, expected):
    monkeypatch.setattr(module, "available_memory", lambda: 5e9)
    assert SolverSettings(memory=memory).memory_limit == pytest.approx(expected)


def test_available_memory_is_no_more_than_the_machine_has():
    assert 0 < available_memory() <= os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
