"""Loops compiled by numba, whose code is kept on disk until the source of any of them changes."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, cast

from numba import njit
from numba.core import config
from numba.misc.appdirs import AppDirs

__all__ = ["loop"]

Function = TypeVar("Function", bound=Callable[..., Any])

# In every source that compiled code may come from.
_MARK = b"numba"


def loop(function: Function) -> Function:
    """Compile a function of arrays and numbers; other threads of Python run beside it.

    Parameters
    ----------
    function : callable

    Returns
    -------
    callable
        Compiled at its first call, or found on disk where that was done before.

    Raises
    ------
    RuntimeError
        If there is no folder that code can be kept in.

    Notes
    -----
    numba itself keeps code until the file of the outermost function changes. What that function calls is compiled
    into it, and would be kept in its old form.
    """
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_folder())
    try:
        return cast(Function, njit(cache=True, nogil=True)(function))
    finally:
        config.CACHE_DIR = before


@cache
def _folder() -> Path:
    """Where code is kept: beside the package, or where the user's caches lie."""
    name = f"multifrontal-{_stamp(Path(__file__).parent):08x}"
    for base in _bases():
        folder = base / name
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "tried").touch()
        except OSError:
            continue
        return folder
    raise RuntimeError("no folder to keep compiled code in: set NUMBA_CACHE_DIR to one that can be written")


def _bases() -> Iterator[Path]:
    if config.CACHE_DIR:
        yield Path(config.CACHE_DIR)
    yield Path(__file__).parent / "__pycache__"
    yield Path(AppDirs(appname="multifrontal", appauthor=False).user_cache_dir)


def _stamp(package: Path) -> int:
    """Number of the sources of all compiled code in a folder."""
    stamp = 0
    for path in sorted(package.glob("*.py")):
        source = path.read_bytes()
        if _MARK in source or b"import loop" in source:
            stamp = zlib.crc32(source, stamp)
    return stamp
