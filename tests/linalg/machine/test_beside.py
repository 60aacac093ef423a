"""Work on a thread of its own: its result, its error, and the settings that it sees."""

from __future__ import annotations

import threading

import pytest

from cmsreduce.linalg.machine import SolverSettings, begun, current_settings, solver_settings


@pytest.mark.parametrize(("threads", "beside", "apart"), [(2, True, True), (2, False, False), (1, True, False)])
def test_the_settings_in_force_are_those_of_the_caller(threads: int, beside: bool, apart: bool) -> None:
    with solver_settings(SolverSettings("superlu", threads=threads)):
        found = begun(lambda: (current_settings().backend, threading.get_ident()), beside=beside)
    backend, thread = found.result()
    assert backend == "superlu"
    assert (thread != threading.get_ident()) is apart


def test_the_caller_goes_on_meanwhile() -> None:
    met = threading.Event()
    with solver_settings(SolverSettings(threads=2)):
        waiting = begun(lambda: met.wait(60))
    met.set()
    assert waiting.result() is True


@pytest.mark.parametrize("threads", [1, 2])
def test_an_error_is_that_of_the_work(threads: int) -> None:
    def fails() -> None:
        raise ValueError("of the work")

    with solver_settings(SolverSettings(threads=threads)), pytest.raises(ValueError, match="of the work"):
        begun(fails).result()
