"""Work on several bodies at once in the threads of one process, as if it were done on one after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

from cmsreduce.linalg.machine import allowed_threads
from cmsreduce.pipeline.store.diagnostics import Failures, collecting, report_failures
from cmsreduce.pipeline.store.stages import Stages

__all__ = ["at_once"]

T = TypeVar("T")


def at_once(stages: Stages, work: Callable[[str], T], names: Sequence[str], threads: int) -> list[T]:
    """Results of a piece of work on each of some bodies, several bodies at a time, in the order of the bodies.

    Each body has the context of the caller, such as solver settings, and its share of the threads. Failures of
    diagnostics are reported in the order of the bodies.

    Parameters
    ----------
    stages : Stages
        Cache of the run that the work is done for.
    work : callable
        Takes the name of a body. It touches nothing that the work on another body touches, but the cache of stages.
    names : sequence of str
        The bodies.
    threads : int
        Number of bodies at a time.

    Raises
    ------
    Exception
        The error of the first body, in their order, whose work fails; the results of the others stay in the cache.
    """

    def collected(name: str) -> tuple[T, Failures]:
        with collecting(Failures(log=stages.failures.log)) as failed:
            return work(name), failed

    each, results = max(1, stages.solver.thread_count // max(1, min(threads, len(names)))), []
    # Here, because OpenBLAS does not take the number from another thread once this one has set it.
    with allowed_threads(each), ThreadPoolExecutor(threads) as pool:
        contexts = [copy_context() for _ in names]
        try:
            for result, failed in pool.map(lambda context, name: context.run(collected, name), contexts, names):
                report_failures(failed)
                results.append(result)
        except (KeyboardInterrupt, SystemExit):
            # Ctrl-C, or what another library makes of it: the threads end before their next piece of work.
            stages.interrupted = True
            raise
    return results
