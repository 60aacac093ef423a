"""MKL factors that do not fit in memory: a file holds the entries, mapped at the addresses that MKL uses."""

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

# Bytes of a factor for each row, to judge whether it may outgrow memory: a compact solid of 1e6 dofs in single
# precision.
_BYTES_A_ROW = 8000
# An allocation of at least this size holds all entries of a factor; malloc gives it a mapping of its own.
_LARGE = 32 * 2**20
# Flag of mmap, flag of memory that malloc maps, and the value that mmap returns if it fails.
_FIXED, _OWN_MAPPING, _FAILED = 0x10, 2, ctypes.c_void_p(-1).value
# Attempts to get memory with a mapping of its own.
_TRIES = 8
_ALLOCATE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t)


class _Entries:
    """State of MKL's allocations while a factor is made.

    No record is needed for the moment when MKL frees the memory: the system's `free` unmaps all pages at this address.
    """

    def __init__(self) -> None:
        # The function that MKL calls, possibly until the process ends, and its library.
        self.replaced: list[Any] = []
        self.called = False
        # Set while a factor is made on disk; any thread of MKL may allocate its memory.
        self.folder: Path | None = None


_ENTRIES = _Entries()


def watch_if_large(n: int) -> None:
    """Replace MKL's allocator if the settings allow it and a factor of n rows may outgrow memory.

    Parameters
    ----------
    n : int
        Rows.

    Notes
    -----
    MKL looks up its allocator only once, at its first use. The allocator is not replaced for small matrices: code that
    calls MKL while it holds Python's lock would wait for itself.
    Source: Intel oneAPI Math Kernel Library, developer guide, "Redefining Memory Functions" (i_malloc).
    """
    settings = current_settings()
    if settings.replace_allocators and settings.scratch is not None and _BYTES_A_ROW * n > settings.memory_limit:
        _replace_allocator()


def can_be_mapped() -> bool:
    """True if MKL uses the allocator of this module."""
    return _ENTRIES.called


def free_on_disk(folder: Path) -> float:
    """Free bytes on the disk of a folder, which need not exist yet."""
    existing = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    return float(shutil.disk_usage(existing).free)


@contextmanager
def mapped_entries(folder: Path | None) -> Iterator[None]:
    """Put the entries of factors that MKL makes within a `with` block into files.

    Parameters
    ----------
    folder : Path, optional
        Folder of the files; None leaves the entries in memory.
    """
    _ENTRIES.folder = folder
    try:
        yield
    finally:
        _ENTRIES.folder = None


def _replace_allocator() -> None:
    library = mkl_library()
    if sys.platform != "linux" or _ENTRIES.replaced or library is None or library._name is None:
        return
    beside = Path(library._name)
    try:
        # A call that needs no memory makes the runtime load the library with the allocator.
        library.MKL_Set_Num_Threads_Local(0)
        core = ctypes.CDLL(str(beside.with_name(beside.name.replace("_rt", "_core"))))
        pointer = ctypes.c_void_p.in_dll(core, "i_malloc")
        system = _system()
        library.MKL_malloc.restype, library.MKL_malloc.argtypes = ctypes.c_void_p, (ctypes.c_size_t, ctypes.c_int)
        library.MKL_free.restype, library.MKL_free.argtypes = None, (ctypes.c_void_p,)
    except (OSError, ValueError, AttributeError):
        return
    allocate = _ALLOCATE(pointer.value or 0)

    def allocated(size: int) -> int | None:
        _ENTRIES.called = True
        address: int | None = allocate(size)
        if address is None or size < _LARGE or _ENTRIES.folder is None:
            return address
        rejected: list[int] = []
        while address is not None and not _has_own_mapping(address) and len(rejected) < _TRIES:
            # This piece comes from memory freed before; there are few of them.
            rejected.append(address)
            address = allocate(size)
        for each in rejected:
            system.free(each)
        own = (
            address is not None
            and _has_own_mapping(address)
            and _put_on_disk(system, *_pages(address, size), _ENTRIES.folder)
        )
        return address if own else None

    _ENTRIES.replaced = [_ALLOCATE(allocated), core]
    pointer.value = ctypes.cast(_ENTRIES.replaced[0], ctypes.c_void_p).value
    # Test it: MKL does not call the new allocator if it allocated memory before.
    library.MKL_free(library.MKL_malloc(_LARGE, mmap.PAGESIZE))


def _system() -> ctypes.CDLL:
    """The C library's functions for memory."""
    system, address, size, number = ctypes.CDLL(None), ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    system.mmap.restype, system.mmap.argtypes = address, (address, size, number, number, number, ctypes.c_long)
    system.free.restype, system.free.argtypes = None, (address,)
    return system


def _put_on_disk(system: ctypes.CDLL, start: int, length: int, folder: Path) -> bool:
    """Replace the pages of new memory by those of a file without a name; false if this fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            # Reserve the whole file now: a page without room on disk would later end the process.
            os.posix_fallocate(file.fileno(), 0, length)
            rights = mmap.PROT_READ | mmap.PROT_WRITE
            address = system.mmap(start, length, rights, mmap.MAP_SHARED | _FIXED, file.fileno(), 0)
    except OSError:
        return False
    return bool(address != _FAILED)


def _has_own_mapping(address: int) -> bool:
    """True if memory has a mapping of its own, which `free` unmaps; the C library marks it in front of the memory."""
    head = 2 * ctypes.sizeof(ctypes.c_size_t)
    marks = ctypes.c_size_t.from_address(address - head // 2).value
    return address % mmap.PAGESIZE == head and bool(marks & _OWN_MAPPING)


def _pages(address: int, size: int) -> tuple[int, int]:
    """Address of the first whole page in some memory, and the bytes of all whole pages."""
    start = -(-address // mmap.PAGESIZE) * mmap.PAGESIZE
    return start, (address + size - start) // mmap.PAGESIZE * mmap.PAGESIZE
