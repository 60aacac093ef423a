"""The thread count of dense algebra is set within a block and reset after it."""

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from cmsreduce.multifrontal import blas_threads


def threads() -> list[int]:
    """Threads of the BLAS libraries of numpy and scipy; other packages bring BLAS libraries of their own."""
    return [each["num_threads"] for each in threadpool_info() if "libscipy_openblas" in each["filepath"]]


@pytest.fixture(autouse=True)
def two():
    """Set two threads, independent of the environment."""
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


def test_overlapping_blocks_of_two_threads_reset_the_count():
    first, second = blas_threads(1), blas_threads(1)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    assert set(threads()) == {1}
    second.__exit__(None, None, None)
    assert set(threads()) == {2}
