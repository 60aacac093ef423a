"""Runs in one directory come one after the other: two would write results of different settings side by side."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["sole_use"]


@contextmanager
def sole_use(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Keep other processes out of a folder while the block lasts; wait for one that is in it.

    The system takes the claim back when a process ends, however it ends. The folder itself is locked, so that nothing
    is left in it.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    say : callable
        Told that there is something to wait for.
    """
    try:
        import fcntl
    except ImportError:
        # Without locks each file is still whole, whoever wrote it last.
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        # Whoever writes the first file names what is wrong with the folder.
        yield
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"another run is at work in {folder}; this one goes on when that ends (or give it another --out)")
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            # Some shared disks lock no folders.
            pass
        yield
    finally:
        os.close(handle)
