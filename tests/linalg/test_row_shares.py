"""Rows shared by threads: each of them once, and no failure lost."""

from threading import get_ident

import numpy as np
import pytest

from cmsreduce.linalg.row_shares import share_rows
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("n", [0, 1, 5, 4096, 4097, 100_000])
def test_each_row_belongs_to_one_thread(n, threads):
    done, seen = np.zeros(n, dtype=int), {}

    def work(thread: int, low: int, high: int) -> None:
        done[low:high] += 1
        seen[thread] = get_ident()

    with solver_settings(SolverSettings(threads=threads)):
        share_rows(n, work)
    assert (done == 1).all()
    assert sorted(seen) == list(range(threads if n > 4096 else 1))


@pytest.mark.parametrize("n", [10, 100_000])
def test_a_failure_is_raised(n):
    def work(thread: int, low: int, high: int) -> None:
        raise ArithmeticError(f"rows {low} to {high}")

    with (
        pytest.raises(ArithmeticError, match=f"rows 0 to {n if n < 4096 else n // 2}"),
        solver_settings(SolverSettings(threads=2)),
    ):
        share_rows(n, work)
