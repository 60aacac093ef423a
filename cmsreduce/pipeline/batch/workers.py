"""Processes that share the work of a sweep or a run: of this machine, or of a cluster."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing import get_all_start_methods, get_context, parent_process
from multiprocessing.util import Finalize
from threading import Lock, Thread
from typing import Any

from cmsreduce.linalg.machine import allowed_threads, available_memory, end_openmp, usable_cores
from cmsreduce.pipeline.store import CommonWork

__all__ = ["Workers", "common_work", "local_workers"]

# Share of the free memory that the factors of all processes may take together; the rest is for their bases.
_SHARE = 0.9
# A process of a cluster may run tasks in threads; one task at a time uses the cores and the settings of libraries.
_TURN = Lock()


@dataclass(frozen=True)
class Workers:
    """Processes that run tasks.

    Parameters
    ----------
    count : int
        Number of tasks at a time.
    threads : int
        Threads of each task, so that all tasks together use the cores once; 0 if the processes know their number.
    memory : float or None
        Bytes that a factor of one task may take beside the other tasks. A task that needs more is run alone.
    start : callable
        Takes the number of tasks at a time, and gives a context with an executor.
    lost : tuple of exception types
        Errors of a future whose process died.
    here : bool
        One task at a time on this machine, so that no other process is needed.
    """

    count: int
    threads: int
    memory: float | None
    start: Callable[[int], AbstractContextManager[Executor]]
    lost: tuple[type[BaseException], ...]
    here: bool = False

    def submit(self, executor: Executor, work: Callable[..., Any], *arguments: object) -> Future[Any]:
        """Submit a piece of work to a process, with its share of the threads."""
        return executor.submit(_in_turn, self.threads, work, *arguments)


def local_workers(jobs: int) -> Workers:
    """Processes of this machine, which share its cores and its memory evenly.

    Parameters
    ----------
    jobs : int
        Number of processes.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    threads, memory = max(1, min(usable_cores(), cores // jobs)), _SHARE * available_memory() / jobs
    return Workers(jobs, threads, memory, _started, (BrokenProcessPool,), jobs == 1)


@lru_cache(maxsize=1)
def common_work(sweep: str) -> CommonWork:
    """Work that the tasks of one process share in one sweep; files may change before the next, processes may stay."""
    return CommonWork()


@contextmanager
def _started(jobs: int) -> Iterator[Executor]:
    # Not forked from this process: threads of libraries do not survive a fork. The other one has none at work.
    method = "forkserver" if "forkserver" in get_all_start_methods() else "spawn"
    pool = ProcessPoolExecutor(jobs, get_context(method), _begin_process)
    try:
        for _ in range(jobs):
            pool.submit(_awake)
        yield pool
    finally:
        # An interrupted sweep does not wait for points that have not begun.
        pool.shutdown(cancel_futures=True)


def _awake() -> None:
    """Do nothing: an executor starts a process for its first task."""


def _in_turn(threads: int, work: Callable[..., Any], *arguments: object) -> Any:
    with _TURN, allowed_threads(threads) if threads else nullcontext():
        return work(*arguments)


def _begin_process() -> None:
    """Let the process end with its parent, and at Ctrl-C without a word: the parent says what is to be said."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        # The command line starts processes with the signal blocked, so that none is interrupted before this.
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    # Processes of a pool end without the steps that libraries take at the end of a program.
    Finalize(None, end_openmp, exitpriority=0)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End the process if its parent is killed; a file is complete or absent at any moment."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
