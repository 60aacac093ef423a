"""Thread count of the BLAS library that numpy and scipy call."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from threading import Lock
from typing import Any

from scipy.linalg import blas as _loaded  # noqa: F401 - loads the library whose threads are set
from threadpoolctl import ThreadpoolController

__all__ = ["blas_threads"]


class _Scopes:
    """Thread counts of the open `with` blocks, and the counts before the first of them."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.wanted: list[list[int]] = []
        self.before: list[int] = []


_SCOPES = _Scopes()


@contextmanager
def blas_threads(count: int) -> Iterator[None]:
    """Set the thread count of dense algebra within a `with` block, in the whole process.

    The block that was entered last decides; after the last block ends, the library has as many threads as before. MKL
    is not changed if numpy and scipy call another BLAS: the caller of MKL sets its threads at each call.

    OpenBLAS ignores the number of another thread once the main thread has set one: begin the block before them.

    Parameters
    ----------
    count : int
        At least 1.
    """
    libraries, mine = _libraries(), [count]
    with _SCOPES.lock:
        if not _SCOPES.wanted:
            _SCOPES.before = [library.get_num_threads() for library in libraries]
        _SCOPES.wanted.append(mine)
        _set(libraries, [count] * len(libraries))
    try:
        yield
    finally:
        with _SCOPES.lock:
            # By identity: another block may want the same number.
            _SCOPES.wanted = [each for each in _SCOPES.wanted if each is not mine]
            _set(libraries, _SCOPES.wanted[-1] * len(libraries) if _SCOPES.wanted else _SCOPES.before)


def _set(libraries: list[Any], counts: list[int]) -> None:
    for library, count in zip(libraries, counts, strict=True):
        library.set_num_threads(count)


@cache
def _libraries() -> list[Any]:
    found: list[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    return [library for library in found if library.internal_api != "mkl"] or found
