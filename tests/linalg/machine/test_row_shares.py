"""Threads share rows: each row is worked on once, and errors reach the caller."""

from threading import get_ident

import numpy as np
import pytest

from cmsreduce.linalg.machine import SolverSettings, share_rows, solver_settings


@pytest.mark.parametrize("threads", [1, 2, 3, 7])
@pytest.mark.parametrize("n", [0, 1, 5, 4096, 4097, 100_000])
def test_each_row_belongs_to_one_thread(n, threads):
    done, longest, seen = np.zeros(n, dtype=int), [], {}

    def work(thread: int, rows: slice) -> None:
        done[rows] += 1
        longest.append(rows.stop - rows.start)
        seen.setdefault(thread, set()).add(get_ident())

    with solver_settings(SolverSettings(threads=threads)):
        share_rows(n, 700, work)
    assert (done == 1).all() and max(longest, default=0) <= 700
    assert sorted(seen) == list(range(threads if n > 4096 else min(n, 1)))
    assert all(len(idents) == 1 for idents in seen.values())


@pytest.mark.parametrize("n", [10, 100_000])
def test_an_error_reaches_the_caller(n):
    def work(thread: int, rows: slice) -> None:
        raise ArithmeticError(f"rows from {rows.start}")

    with (
        pytest.raises(ArithmeticError, match="rows from 0"),
        solver_settings(SolverSettings(threads=2)),
    ):
        share_rows(n, 700, work)
