"""Threads of the BLAS that numpy and scipy call."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from threadpoolctl import ThreadpoolController

__all__ = ["one_blas_thread"]


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """Have dense algebra take one thread within a `with` block, in the whole process.

    MKL is left alone where numpy and scipy call another BLAS: once it has been told anything, it no longer asks where
    to put the entries of a large factor (see `mkl_memory`).
    """
    with _controller().limit(limits=1):
        yield


@cache
def _controller() -> ThreadpoolController:
    found = ThreadpoolController().select(user_api="blas")
    own = sorted({library.internal_api for library in found.lib_controllers} - {"mkl"})
    return found.select(internal_api=own) if own else found
