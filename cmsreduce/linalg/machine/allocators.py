"""Reuse of memory pages: pages that one step of a reduction frees serve the next step instead of the system."""

from __future__ import annotations

import ctypes
import mmap
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

__all__ = ["reusable_bytes", "reused_pages"]

# For matrices of fewer rows the cost of new pages does not matter.
_LEAST_ROWS = 20_000
# Bytes for each row for which huge pages are requested: the factors and blocks of vectors of a solid. Memory that is
# not used takes no pages.
_BYTES_A_ROW = 16_000
# The C library's parameters, and the values that it reaches by itself in a program that frees large blocks.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _MMAP_MAX = -1, -3, -4
_OWN = {_TRIM_THRESHOLD: 64 * 2**20, _MMAP_THRESHOLD: 32 * 2**20, _MMAP_MAX: 65536}
_NEVER = -1
_HUGE = 2 * 2**20
_KIB = 1024.0


class _Usage(ctypes.Structure):
    """The C library's `mallinfo2`."""

    _fields_ = (
        *((name, ctypes.c_size_t) for name in ("arena", "pieces", "small", "mappings", "mapped", "most", "small_free")),
        *((name, ctypes.c_size_t) for name in ("used", "free", "top")),
    )


class _Scopes:
    """Number of `with` blocks that reuse pages at this moment."""

    def __init__(self) -> None:
        self.open = 0
        self.lock = threading.Lock()


_SCOPES = _Scopes()


@contextmanager
def reused_pages(n: int, limit: float) -> Iterator[None]:
    """Reuse the pages of freed memory within a `with` block, and request huge pages.

    The first access to a page costs 0.1 to 0.4 s a GiB, and 2.5 s on a virtual machine whose host has to find it: as
    much as a factorisation. At the end of the block all free pages go back to the system.

    Parameters
    ----------
    n : int
        Rows of the matrices; nothing is done for small ones.
    limit : float
        Bytes that a factor may take. Nothing is done where the factor may come near this limit (16 kB a row).

    Notes
    -----
    This needs the GNU C library; with any other nothing changes. By default that library maps each large array and
    unmaps it when it is freed (`mallopt`, M_MMAP_THRESHOLD). Here large arrays lie on the heap, which is not trimmed.
    Huge pages belong to addresses of the heap: an area is requested and freed at once, and later arrays use it.
    """
    library = _library() if n > _LEAST_ROWS and _BYTES_A_ROW * n < limit else None
    if library is None:
        yield
        return
    with _SCOPES.lock:
        _SCOPES.open += 1
        if _SCOPES.open == 1:
            library.mallopt(_MMAP_MAX, 0)
            library.mallopt(_TRIM_THRESHOLD, _NEVER)
            _request_huge_pages(library, _BYTES_A_ROW * n)
    try:
        yield
    finally:
        with _SCOPES.lock:
            _SCOPES.open -= 1
            if not _SCOPES.open:
                for name, value in _OWN.items():
                    library.mallopt(name, value)
                library.malloc_trim(0)


def reusable_bytes() -> float:
    """Bytes of free memory that this process holds for reuse; the system counts them as taken."""
    library = _library() if _SCOPES.open else None
    if library is None:
        return 0.0
    try:
        lines = Path("/proc/self/smaps").read_text().splitlines()
    except OSError:
        return 0.0
    # The heap consists of several mappings, with huge pages and with others. The line "Rss:" of each gives its size.
    heap, resident = False, 0.0
    for line in lines:
        if line.startswith("Rss:"):
            resident += float(line.split()[1]) * _KIB if heap else 0.0
        elif not line.split(" ", 1)[0].endswith(":"):
            heap = line.endswith("[heap]")
    return max(resident - float(library.mallinfo2().used), 0.0)


def _request_huge_pages(library: ctypes.CDLL, size: int) -> None:
    """Request huge pages for the addresses into which the heap will grow."""
    start = library.malloc(size)
    if start is None:
        return
    first = -(-start // _HUGE) * _HUGE
    if start + size > first and hasattr(mmap, "MADV_HUGEPAGE"):
        library.madvise(first, (start + size - first) // _HUGE * _HUGE, mmap.MADV_HUGEPAGE)
    library.free(start)


@cache
def _library() -> ctypes.CDLL | None:
    """The GNU C library; None where this process uses another one."""
    if sys.platform != "linux":
        return None
    library = ctypes.CDLL(None)
    if not all(hasattr(library, name) for name in ("mallopt", "malloc_trim", "mallinfo2")):
        return None
    address, size = ctypes.c_void_p, ctypes.c_size_t
    library.malloc.restype, library.malloc.argtypes = address, (size,)
    library.free.restype, library.free.argtypes = None, (address,)
    library.madvise.restype, library.madvise.argtypes = ctypes.c_int, (address, size, ctypes.c_int)
    library.malloc_trim.argtypes = (size,)
    library.mallinfo2.restype = _Usage
    return library
