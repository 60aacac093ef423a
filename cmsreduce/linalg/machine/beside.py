"""Work on a thread of its own: a factorisation beside it leaves cores idle for a part of its time."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextvars import copy_context
from typing import TypeVar

from cmsreduce.linalg.machine.settings import current_settings

__all__ = ["begun"]

T = TypeVar("T")


def begun(work: Callable[[], T], *, beside: bool = True) -> Future[T]:
    """Begin a piece of work, with the settings in force here.

    Parameters
    ----------
    work : callable
        Releases Python's lock for most of its time.
    beside : bool
        False to do it at once, as where one thread is allowed.

    Returns
    -------
    Future
        Its result, or its error; an error of work that is done at once is raised here.

    Examples
    --------
    >>> begun(lambda: 6 * 7).result()
    42
    """
    if beside and current_settings().thread_count > 1:
        pool = ThreadPoolExecutor(1)
        try:
            return pool.submit(copy_context().run, work)
        finally:
            pool.shutdown(wait=False)
    done: Future[T] = Future()
    done.set_result(work())
    return done
