"""Where the entries of MKL's factors lie: in pages that one takes over from the last, or in a file that is mapped."""

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

__all__ = [
    "can_be_mapped",
    "drop_idle",
    "free_on_disk",
    "handed_on",
    "idle_bytes",
    "leave_pages",
    "mapped_entries",
    "watch_allocations",
]

# Allocations from here on are a factor's entries, one for all of them; malloc maps whatever is as large.
_LARGE = 32 * 2**20
# Flags of mmap and mremap, and of memory that malloc maps; what mmap returns where it fails.
_FIXED, _NO_RESERVE, _MOVE, _TO_THERE, _LEAVE = 0x10, 0x4000, 1, 2, 4
_OWN_MAPPING = 2
# Pages are taken over by what needs so large a share of them.
_ALIKE = 0.5
# Attempts to get a mapping of its own.
_TRIES = 8
_FAILED = ctypes.c_void_p(-1).value
_ALLOCATE = ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_size_t)


class _Entries:
    """Memory of the factors, as MKL asks for it.

    Nothing has to be known when MKL frees it: the system's `free` gives back whatever pages lie there by then.
    """

    def __init__(self) -> None:
        # What MKL calls, and may call until the process ends; the system's functions.
        self.watching: list[Any] = []
        # Whether a factor is being made, whichever of MKL's threads asks for its memory; its folder.
        self.making = False
        self.folder: Path | None = None
        # Where it lies; pages that a factor left for the next, and whether it is to do so.
        self.last: tuple[int, int] | None = None
        self.idle: tuple[int, int] | None = None
        self.keep = False

    def arrange(self, address: int, size: int) -> int | None:
        """Put the pages that are wanted under memory that was just allocated; None if they cannot be had."""
        start, length = _pages(address, size)
        if not _alone(address):
            return address if self.folder is None else None
        if self.folder is not None:
            return address if self._mapped(start, length, self.folder) else None
        self.last = max(self.last or (0, 0), (start, length), key=lambda place: place[1])
        system = self.watching[1]
        # Large pages: a small one that is touched for the first time costs as much as arithmetic on all its numbers.
        system.madvise(start, length, getattr(mmap, "MADV_HUGEPAGE", 0))
        if self.idle is not None and length >= _ALIKE * self.idle[1]:
            (idle, enough), self.idle = self.idle, None
            moved = min(enough, length)
            system.mremap(idle, moved, moved, _MOVE | _TO_THERE, start)
            # Nothing is left of them, or what was too many.
            system.munmap(idle, enough)
        return address

    def _mapped(self, start: int, length: int, folder: Path) -> bool:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder) as file:
                # All of it now: a page that finds no room on disk later would end the process.
                os.posix_fallocate(file.fileno(), 0, length)
                rights = mmap.PROT_READ | mmap.PROT_WRITE
                at = self.watching[1].mmap(start, length, rights, mmap.MAP_SHARED | _FIXED, file.fileno(), 0)
        except OSError:
            return False
        return bool(at != _FAILED)

    def leave(self, place: tuple[int, int] | None) -> None:
        """Move the pages of a factor that is to be freed aside, if they are to be kept."""
        if not self.keep or place is None or self.idle is not None:
            return
        start, length = place
        system, private = self.watching[1], mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS
        aside = system.mmap(None, length, mmap.PROT_READ | mmap.PROT_WRITE, private | _NO_RESERVE, -1, 0)
        if aside == _FAILED:
            return
        # What is left there has no pages, and nobody else can take the place before it is freed.
        if system.mremap(start, length, length, _MOVE | _TO_THERE | _LEAVE, aside) == _FAILED:
            system.munmap(aside, length)
        else:
            self.idle = aside, length

    def drop(self) -> None:
        """Give idle pages back to the system."""
        if self.idle is not None:
            self.watching[1].munmap(*self.idle)
            self.idle = None


_ENTRIES = _Entries()


def watch_allocations(library: ctypes.CDLL) -> None:
    """Have MKL ask here for memory; before its first request, since it looks for whom to ask only once.

    Parameters
    ----------
    library : CDLL
        MKL's runtime, just loaded.

    Notes
    -----
    Source: Intel oneAPI Math Kernel Library, developer guide, "Redefining Memory Functions" (i_malloc).
    """
    if sys.platform != "linux" or _ENTRIES.watching or library._name is None:
        return
    beside = Path(library._name)
    try:
        # An order that needs no memory makes the runtime load the library that allocates.
        library.MKL_Set_Num_Threads_Local(0)
        core = ctypes.CDLL(str(beside.with_name(beside.name.replace("_rt", "_core"))))
        pointer = ctypes.c_void_p.in_dll(core, "i_malloc")
        system = _system()
    except (OSError, ValueError, AttributeError):
        return
    allocate = _ALLOCATE(pointer.value or 0)

    def taken(size: int) -> int | None:
        address: int | None = allocate(size)
        if address is None or size < _LARGE or not _ENTRIES.making:
            return address
        passed: list[int] = []
        while address is not None and not _alone(address) and len(passed) < _TRIES:
            # From what was freed before; there is not much of that.
            passed.append(address)
            address = allocate(size)
        for each in passed:
            system.free(each)
        return None if address is None else _ENTRIES.arrange(address, size)

    _ENTRIES.watching = [_ALLOCATE(taken), system, core]
    pointer.value = ctypes.cast(_ENTRIES.watching[0], ctypes.c_void_p).value


def _system() -> ctypes.CDLL:
    """The C library's functions for pages."""
    system, at, size, number = ctypes.CDLL(None), ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int
    system.mmap.restype, system.mmap.argtypes = at, (at, size, number, number, number, ctypes.c_long)
    system.mremap.restype, system.mremap.argtypes = at, (at, size, size, number, at)
    system.free.restype, system.free.argtypes = None, (at,)
    system.munmap.argtypes, system.madvise.argtypes = (at, size), (at, size, number)
    return system


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
    return bool(_ENTRIES.watching)


def free_on_disk(folder: Path) -> float:
    """Bytes that a file in a folder, there or not yet, may take."""
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    return float(shutil.disk_usage(there).free)


def idle_bytes() -> float:
    """Bytes that the next factor takes over."""
    return 0.0 if _ENTRIES.idle is None else float(_ENTRIES.idle[1])


def drop_idle() -> None:
    """Give pages that no factor took over back to the system."""
    _ENTRIES.drop()


@contextmanager
def mapped_entries(folder: Path | None) -> Iterator[list[tuple[int, int]]]:
    """Keep the entries of a factor that MKL makes within a `with` block in a file.

    Parameters
    ----------
    folder : Path, optional
        Where; without it they stay in memory.

    Yields
    ------
    list of tuple
        Filled at the end: where the entries lie, if in memory.
    """
    places: list[tuple[int, int]] = []
    _ENTRIES.making, _ENTRIES.folder, _ENTRIES.last = True, folder, None
    try:
        yield places
    finally:
        if _ENTRIES.last is not None:
            places.append(_ENTRIES.last)
        _ENTRIES.making, _ENTRIES.folder, _ENTRIES.last = False, None, None
        _ENTRIES.drop()


def leave_pages(places: list[tuple[int, int]]) -> None:
    """Say that a factor is about to be freed."""
    _ENTRIES.leave(places[0] if places else None)


@contextmanager
def handed_on() -> Iterator[None]:
    """Keep the pages of a factor that is freed within a `with` block for the next one that is made.

    A page that is touched for the first time costs a virtual machine as much as hundreds of operations on its numbers.
    The factor that counts modes and the one that solves follow each other.
    """
    _ENTRIES.keep = True
    try:
        yield
    finally:
        _ENTRIES.keep = False
