"""Threads of the BLAS that numpy and scipy call."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

from scipy.linalg import blas as _loaded  # noqa: F401 - the library whose threads are set must have been loaded
from threadpoolctl import ThreadpoolController

__all__ = ["blas_threads"]


class _Scopes:
    """Thread counts that blocks of code asked for and have not left yet, and the counts before the first of them."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.asked: list[list[int]] = []
        self.before: list[int] = []


_SCOPES = _Scopes()


@contextmanager
def blas_threads(count: int) -> Iterator[None]:
    """Have dense algebra take so many threads within a `with` block, in the whole process.

    The last block to be entered decides; when all are left, the library has as many threads as before. MKL is left
    alone where numpy and scipy call another BLAS: the caller of MKL sets its threads call by call.

    Parameters
    ----------
    count : int
        At least 1.
    """
    libraries, mine = _libraries(), [count]
    with _SCOPES.lock:
        if not _SCOPES.asked:
            _SCOPES.before = [library.get_num_threads() for library in libraries]
        _SCOPES.asked.append(mine)
        _set(libraries, [count] * len(libraries))
    try:
        yield
    finally:
        with _SCOPES.lock:
            # By identity: others may have asked for the same number.
            _SCOPES.asked = [each for each in _SCOPES.asked if each is not mine]
            _set(libraries, _SCOPES.asked[-1] * len(libraries) if _SCOPES.asked else _SCOPES.before)


def _set(libraries: list[Any], counts: list[int]) -> None:
    for library, count in zip(libraries, counts, strict=True):
        library.set_num_threads(count)


@cache
def _libraries() -> list[Any]:
    found: list[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    return [library for library in found if library.internal_api != "mkl"] or found
