"""Work on the rows of tall blocks, some at a time, shared by threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cmsreduce.linalg.machine.settings import current_settings

__all__ = ["share_rows"]

# Rows below which a second thread costs more than it saves.
_FEW = 4096


def share_rows(n: int, at_once: int, work: Callable[[int, slice], None]) -> None:
    """Call ``work`` with the number of a thread and some rows, until all rows are done.

    Parameters
    ----------
    n : int
        Rows.
    at_once : int
        Rows of a call at most.
    work : callable
        Releases Python's lock for most of its time, as numpy does in long products and sums.
    """
    threads = current_settings().thread_count if n > _FEW else 1
    cuts = np.linspace(0, n, threads + 1).astype(int).tolist()

    def share(thread: int) -> None:
        low, high = cuts[thread : thread + 2]
        for first in range(low, high, at_once):
            work(thread, slice(first, min(first + at_once, high)))

    if threads == 1:
        share(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(share, range(threads)))
