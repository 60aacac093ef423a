"""A factor of MKL's that does not fit in memory: its entries in a file, mapped where they would lie."""

from __future__ import annotations

import ctypes
import mmap
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cmsreduce.linalg.machine.mkl_library import mkl_library
from cmsreduce.linalg.machine.settings import current_settings

__all__ = ["can_be_mapped", "free_on_disk", "mapped_entries", "watch_if_large"]

# Bytes of a factor for each row, from which on it is prepared for one that does not fit: a compact solid of 1e6 dofs
# in single precision.
_BYTES_A_ROW = 8000
# Allocations from here on are a factor's entries, one for all of them; malloc maps whatever is as large.
_LARGE = 32 * 2**20
# Flags of mmap, and of memory that malloc maps; what mmap returns where it fails.
_FIXED, _OWN_MAPPING, _FAILED = 0x10, 2, ctypes.c_void_p(-1).value
# Attempts to get a mapping of its own.
_TRIES = 8
_ALLOCATE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t)


class _Entries:
    """Memory of the factor that is being made, as MKL asks for it.

    Nothing has to be known when MKL frees it: the system's `free` gives back whatever pages lie there by then.
    """

    def __init__(self) -> None:
        # What MKL calls, and may call until the process ends.
        self.watching: list[Any] = []
        self.asked = False
        # Set while a factor is made that goes to disk, whichever of MKL's threads asks for its memory.
        self.folder: Path | None = None


_ENTRIES = _Entries()


def watch_if_large(n: int) -> None:
    """Have MKL ask here for memory, where settings allow it and a factor of so many rows may outgrow memory.

    Parameters
    ----------
    n : int
        Rows.

    Notes
    -----
    MKL looks for whom to ask only once, when it is used for the first time. Not done for smaller matrices: code that
    calls MKL without letting go of Python's lock would wait for itself.
    Source: Intel oneAPI Math Kernel Library, developer guide, "Redefining Memory Functions" (i_malloc).
    """
    settings = current_settings()
    if settings.replace_allocators and settings.scratch is not None and _BYTES_A_ROW * n > settings.memory_limit:
        _watch()


def _watch() -> None:
    library = mkl_library()
    if sys.platform != "linux" or _ENTRIES.watching or library is None or library._name is None:
        return
    beside = Path(library._name)
    try:
        # An order that needs no memory makes the runtime load the library that allocates.
        library.MKL_Set_Num_Threads_Local(0)
        core = ctypes.CDLL(str(beside.with_name(beside.name.replace("_rt", "_core"))))
        pointer = ctypes.c_void_p.in_dll(core, "i_malloc")
        system = _system()
        library.MKL_malloc.restype, library.MKL_malloc.argtypes = ctypes.c_void_p, (ctypes.c_size_t, ctypes.c_int)
        library.MKL_free.restype, library.MKL_free.argtypes = None, (ctypes.c_void_p,)
    except (OSError, ValueError, AttributeError):
        return
    allocate = _ALLOCATE(pointer.value or 0)

    def taken(size: int) -> int | None:
        _ENTRIES.asked = True
        address: int | None = allocate(size)
        if address is None or size < _LARGE or _ENTRIES.folder is None:
            return address
        passed: list[int] = []
        while address is not None and not _alone(address) and len(passed) < _TRIES:
            # From what was freed before; there is not much of that.
            passed.append(address)
            address = allocate(size)
        for each in passed:
            system.free(each)
        own = address is not None and _alone(address) and _mapped(system, *_pages(address, size), _ENTRIES.folder)
        return address if own else None

    _ENTRIES.watching = [_ALLOCATE(taken), core]
    pointer.value = ctypes.cast(_ENTRIES.watching[0], ctypes.c_void_p).value
    # Whether it asks: not if it had memory before.
    library.MKL_free(library.MKL_malloc(_LARGE, mmap.PAGESIZE))


def _system() -> ctypes.CDLL:
    """The C library's functions for memory."""
    system, at, size, number = ctypes.CDLL(None), ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    system.mmap.restype, system.mmap.argtypes = at, (at, size, number, number, number, ctypes.c_long)
    system.free.restype, system.free.argtypes = None, (at,)
    return system


def _mapped(system: ctypes.CDLL, start: int, length: int, folder: Path) -> bool:
    """Put the pages of a file without a name where memory was just allocated; false where they cannot be had."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            # All of it now: a page that finds no room on disk later would end the process.
            os.posix_fallocate(file.fileno(), 0, length)
            rights = mmap.PROT_READ | mmap.PROT_WRITE
            at = system.mmap(start, length, rights, mmap.MAP_SHARED | _FIXED, file.fileno(), 0)
    except OSError:
        return False
    return bool(at != _FAILED)


def _alone(address: int) -> bool:
    """Whether memory is a mapping of its own, which is unmapped when it is freed: the C library marks it as such."""
    head = 2 * ctypes.sizeof(ctypes.c_size_t)
    marks = ctypes.c_size_t.from_address(address - head // 2).value
    return address % mmap.PAGESIZE == head and bool(marks & _OWN_MAPPING)


def _pages(address: int, size: int) -> tuple[int, int]:
    """First whole page of some memory, and the bytes of all of them."""
    start = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    return start, (address + size - start) // mmap.PAGESIZE * mmap.PAGESIZE


def can_be_mapped() -> bool:
    """Whether MKL asks here for memory."""
    return _ENTRIES.asked


def free_on_disk(folder: Path) -> float:
    """Bytes that a file in a folder, there or not yet, may take."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    return float(shutil.disk_usage(there).free)


@contextmanager
def mapped_entries(folder: Path | None) -> Iterator[None]:
    """Keep the entries of a factor that MKL makes within a `with` block in a file.

    Parameters
    ----------
    folder : Path, optional
        Where; without it they stay in memory.
    """
    _ENTRIES.folder = folder
    try:
        yield
    finally:
        _ENTRIES.folder = None
