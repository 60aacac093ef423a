"""Loops compiled by numba; the compiled code stays on disk until the source of any loop changes."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import config
from numba.misc.appdirs import AppDirs

__all__ = ["compiled_folder", "loop"]

Function = TypeVar("Function", bound=Callable[..., Any])

# Each source of compiled code contains one of these words.
_MARKS = b"numba", b"import loop"


def loop(function: Function) -> Function:
    """Compile a function of arrays and numbers; it releases Python's lock.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
        Compiled at its first call, or read from disk.

    Raises
    ------
    RuntimeError
        If no folder for the compiled code can be written.

    Notes
    -----
    numba's own cache checks the file of the called function only. The functions inside it are compiled into it, and
    would stay in their old form.
    """
    before = config.CACHE_DIR
    config.CACHE_DIR = str(compiled_folder())
    try:
        return cast(Function, njit(cache=True, nogil=True)(function))
    finally:
        config.CACHE_DIR = before


@cache
def compiled_folder() -> Path:
    """Folder for compiled code: NUMBA_CACHE_DIR, beside the package, or in the user's cache folder."""
    name = f"multifrontal-{_stamp(Path(__file__).parent):08x}"
    for base in _bases():
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "tried").touch()
        except OSError:
            continue
        return folder
    raise RuntimeError("no folder for compiled code: set NUMBA_CACHE_DIR to a folder that can be written")


def _bases() -> Iterator[Path]:
    if config.CACHE_DIR:
        yield Path(config.CACHE_DIR)
    yield Path(__file__).parent / "__pycache__"
    yield Path(AppDirs(appname="multifrontal", appauthor=False).user_cache_dir)


def _stamp(package: Path) -> int:
    """Checksum of the sources of all compiled code in a folder."""
    stamp = 0
    for path in sorted(package.glob("*.py")):
        source = path.read_bytes()
        if any(mark in source for mark in _MARKS):
            stamp = zlib.crc32(source, stamp)
    return stamp
