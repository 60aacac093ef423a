"""Files that appear under their name only when they are whole.

Text files of numbers, written whole.
"""

from __future__ import annotations

import contextlib
import os
import platform
import re
import secrets
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError

__all__ = [
    "atomic_path",
    "number",
    "put_lines",
    "table",
]


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Write to a temporary name in the same folder, and rename when the block ends without an error.

    Parameters
    ----------
    path : Path
        Where the file is to be; its folders are made.

    Yields
    ------
    Path
        Where to write it.

    Raises
    ------
    WriteError
        If the folder cannot be written, or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path)
        temporary = path.with_name(f".{path.name}.{_machine()}-{os.getpid()}-{secrets.token_hex(4)}.tmp")
        try:
            yield temporary
            _flush(temporary)
            temporary.replace(path)
            # Some disks do not flush folders; the file is in its place by now.
            with contextlib.suppress(OSError):
                _flush(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written: {error.strerror or error}. Nothing was changed; free space or choose another "
            "`output:` (or --out)"
        ) from None


def _flush(path: Path) -> None:
    """Have the disk hold what the system only promised, so that a power cut finds the old file or the new one."""
    # Windows flushes only what is open for writing.
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sweep(path: Path) -> None:
    """Remove what killed processes of this machine left of earlier attempts at the same file."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.{_machine()}-(\d+)-[0-9a-f]+\.tmp")
    for left in path.parent.iterdir():
        found = ours.fullmatch(left.name)
        if found and not _alive(int(found[1])):
            with contextlib.suppress(OSError):
                left.unlink()


def _machine() -> str:
    # On a shared disk the process of another machine is alive, though its number means nothing here.
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _alive(pid: int) -> bool:
    if os.name != "posix":
        # Elsewhere os.kill ends the process that it is asked about.
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def put_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines of ASCII; characters beyond it, as in a body's name, become question marks.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    content = "".join(f"{line}\n" for line in lines)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode("ascii", errors="replace"))


def number(value: float) -> str:
    """A number with all the digits of double precision.

    Examples
    --------
    >>> number(0.1)
    '1.0000000000000001e-01'
    """
    return f"{value:.16e}"


def table(name: str, values: NDArray[np.float64] | NDArray[np.int64], meaning: str = "") -> Iterator[str]:
    """A block of numbers under a line ``$ NAME rows columns: meaning``.

    Parameters
    ----------
    name : str
        Capital letters, by which the block is found.
    values : (r, c) float64 or int64
        Rows of numbers.
    meaning : str
        In words, for whoever opens the file.
    """
    rows, columns = values.shape
    yield f"$ {name} {rows} {columns}: {meaning}" if meaning else f"$ {name} {rows} {columns}"
    for row in values:
        yield " ".join(str(value) if values.dtype.kind == "i" else number(value) for value in row)
