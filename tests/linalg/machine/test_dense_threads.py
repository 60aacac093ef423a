"""Settings limit the threads of dense algebra."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from cmsreduce.linalg.machine import SolverSettings, allowed_threads, solver_settings


def threads() -> list[int]:
    """Threads of the BLAS libraries of numpy and scipy; other packages bring BLAS libraries of their own."""
    return [each["num_threads"] for each in threadpool_info() if "libscipy_openblas" in each["filepath"]]


@pytest.fixture(autouse=True)
def two():
    """Set two threads, independent of the environment."""
    with threadpool_limits(2, "blas"):
        yield


def test_settings_take_one_thread_unless_they_name_more():
    with solver_settings(SolverSettings()):
        assert set(threads()) == {1}
    with solver_settings(SolverSettings(threads=2)):
        assert set(threads()) == {2}
    assert set(threads()) == {2}


def test_allowed_threads_are_not_exceeded():
    with allowed_threads(1):
        assert SolverSettings().thread_count == 1 and set(threads()) == {1}
        assert SolverSettings(threads=2).thread_count == 2
    assert set(threads()) == {2}
