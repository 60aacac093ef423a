"""Processes that share the work of a sweep or a run: of this machine, or of a cluster."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing import get_context, parent_process
from threading import Lock, Thread
from typing import Any

from cmsreduce.linalg.machine import allowed_threads, available_memory, usable_cores

__all__ = ["Workers", "local_workers"]

# Share of the free memory that the processes may take together: the rest is for the bases beside the factors.
_SHARE = 0.9
# A process of a cluster may run its tasks in threads; ours want the cores, and the libraries' settings, to themselves.
_TURN = Lock()


@dataclass(frozen=True)
class Workers:
    """Where tasks are run.

    Parameters
    ----------
    count : int
        Tasks that are run at a time.
    threads : int
        Threads of each, so that the cores are not asked for twice; 0 where the workers know themselves.
    memory : float or None
        Bytes that a factor of one task may take beside the others. What needs more is run alone.
    start : callable
        Takes the number of tasks at a time, gives a context with an executor.
    lost : tuple of exception types
        What a future raises if the process of its task died.
    here : bool
        Whether there is no need of another process: one task at a time, on this machine.
    """

    count: int
    threads: int
    memory: float | None
    start: Callable[[int], AbstractContextManager[Executor]]
    lost: tuple[type[BaseException], ...]
    here: bool = False

    def submit(self, executor: Executor, work: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Let a process do a piece of work with its share of the threads."""
        return executor.submit(_in_turn, self.threads, work, *arguments)


def local_workers(jobs: int) -> Workers:
    """Processes of this machine, which share its cores and its memory evenly.

    Parameters
    ----------
    jobs : int
        How many.
    """
    threads, memory = _threads_each(jobs), _SHARE * available_memory() / jobs
    return Workers(jobs, threads, memory, _pool, (BrokenProcessPool,), jobs == 1)


@contextmanager
def _pool(jobs: int) -> Iterator[Executor]:
    # Started afresh, not forked: threads of the libraries do not survive a fork.
    pool = ProcessPoolExecutor(jobs, get_context("spawn"), _begin_process)
    try:
        for _ in range(jobs):
            pool.submit(_awake)
        yield pool
    finally:
        # An interrupted sweep does not wait for the points that have not begun.
        pool.shutdown(cancel_futures=True)


def _threads_each(jobs: int) -> int:
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(usable_cores(), cores // jobs))


def _awake() -> None:
    """Nothing: a process is started with its first task, while others are prepared."""


def _in_turn(threads: int, work: Callable[..., Any], *arguments: object) -> Any:
    with _TURN, allowed_threads(threads) if threads else nullcontext():
        return work(*arguments)


def _begin_process() -> None:
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Leave when the parent is killed, instead of waiting for tasks for ever; files are whole or not there."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
