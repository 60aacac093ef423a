"""Threads of dense algebra are limited within a block and given back after it."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from cmsreduce.multifrontal import blas_threads


def threads() -> list[int]:
    """Threads of the BLAS libraries of numpy and scipy; other packages bring BLAS libraries of their own."""
    return [each["num_threads"] for each in threadpool_info() if "libscipy_openblas" in each["filepath"]]


@pytest.fixture(autouse=True)
def two():
    """Two threads, whatever the environment says."""
    with threadpool_limits(2, "blas"):
        yield


def test_one_thread_and_then_as_before():
    assert set(threads()) == {2}
    with blas_threads(1):
        assert set(threads()) == {1}
        with blas_threads(2):
            assert set(threads()) == {2}
        assert set(threads()) == {1}
    assert set(threads()) == {2}


def test_blocks_of_two_threads_that_overlap_leave_nothing_behind():
    first, second = blas_threads(1), blas_threads(1)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert set(threads()) == {1}
    second.__exit__(None, None, None)
    assert set(threads()) == {2}
