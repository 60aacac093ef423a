"""Work on the rows of tall blocks, shared by threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["share_rows"]

# Rows below which a second thread costs more than it saves.
_FEW = 4096


def share_rows(n: int, work: Callable[[int, int, int], None]) -> None:
    """Call ``work`` in each thread with its number, and its first and last row: not with one of another.

    Parameters
    ----------
    n : int
        Rows.
    work : callable
        Releases Python's lock for most of its time, as numpy does in long products and sums.
    """
    threads = current_settings().thread_count if n > _FEW else 1
    if threads == 1:
        return work(0, 0, n)
    cuts = np.linspace(0, n, threads + 1).astype(int).tolist()
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(lambda t: work(t, cuts[t], cuts[t + 1]), range(threads)))
    return None
