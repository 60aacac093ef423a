"""Memory that one step of a reduction leaves to the next, page by page, instead of giving it back to the system."""

from __future__ import annotations

import ctypes
import mmap
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

__all__ = ["kept_bytes", "kept_pages"]

# Bodies of fewer rows are done before a page counts.
_LEAST_ROWS = 20_000
# Bytes for each row that huge pages are asked for: the factors and blocks of vectors of a solid. What is not used takes
# no memory.
_BYTES_A_ROW = 16_000
# The C library's names for what is set, and what it arrives at by itself in a program that frees large blocks.
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
    """Blocks of code that keep their pages, and are being run."""

    def __init__(self) -> None:
        self.open = 0
        self.lock = threading.Lock()


_SCOPES = _Scopes()


@contextmanager
def kept_pages(n: int, limit: float) -> Iterator[None]:
    """Use the pages of what is freed within a `with` block again within it, and ask for huge ones.

    A page that is touched for the first time costs 0.1 to 0.4 s a GiB, on a virtual machine whose host has to find it
    2.5 s: as much as a factorisation. At the end what is free goes back to the system.

    Parameters
    ----------
    n : int
        Rows of the matrices; few need no such care.
    limit : float
        Bytes that a factor may take: what may come near it (8 kB a row) is left to the system, page by page.

    Notes
    -----
    Only with the GNU C library; elsewhere nothing is changed. It maps large arrays one by one and unmaps them when they
    are freed (`mallopt`, M_MMAP_THRESHOLD); here they come out of its heap, which is not trimmed. Huge pages are a
    matter of the heap's addresses: those that are asked for and freed at once are touched by what comes next.
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
            _reserve(library, _BYTES_A_ROW * n)
    try:
        yield
    finally:
        with _SCOPES.lock:
            _SCOPES.open -= 1
            if not _SCOPES.open:
                for name, value in _OWN.items():
                    library.mallopt(name, value)
                library.malloc_trim(0)


def kept_bytes() -> float:
    """Bytes of memory that are kept and free to be used: the system counts them as taken."""
    library = _library() if _SCOPES.open else None
    if library is None:
        return 0.0
    try:
        lines = Path("/proc/self/smaps").read_text().splitlines()
    except OSError:
        return 0.0
    # The heap is several mappings, those of huge pages and others; the next line but a few says what is there of each.
    heap, resident = False, 0.0
    for line in lines:
        if line.startswith("Rss:"):
            resident += float(line.split()[1]) * _KIB if heap else 0.0
        elif not line.split(" ", 1)[0].endswith(":"):
            heap = line.endswith("[heap]")
    return max(resident - float(library.mallinfo2().used), 0.0)


def _reserve(library: ctypes.CDLL, size: int) -> None:
    """Ask for huge pages where the heap grows to."""
    start = library.malloc(size)
    if start is None:
        return
    first = -(-start // _HUGE) * _HUGE
    if start + size > first and hasattr(mmap, "MADV_HUGEPAGE"):
        library.madvise(first, (start + size - first) // _HUGE * _HUGE, mmap.MADV_HUGEPAGE)
    library.free(start)


@cache
def _library() -> ctypes.CDLL | None:
    """The GNU C library, where this is one of its programs."""
    if sys.platform != "linux":
        return None
    library = ctypes.CDLL(None)
    if not all(hasattr(library, name) for name in ("mallopt", "malloc_trim", "mallinfo2")):
        return None
    at, size = ctypes.c_void_p, ctypes.c_size_t
    library.malloc.restype, library.malloc.argtypes = at, (size,)
    library.free.restype, library.free.argtypes = None, (at,)
    library.madvise.restype, library.madvise.argtypes = ctypes.c_int, (at, size, ctypes.c_int)
    library.malloc_trim.argtypes = (size,)
    library.mallinfo2.restype = _Usage
    return library
