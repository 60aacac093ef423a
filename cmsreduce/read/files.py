"""Files that may be missing, empty or damaged: every failure becomes one clear message."""

from __future__ import annotations

import codecs
import difflib
import hashlib
import struct
import time
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import lru_cache
from pathlib import Path
from struct import Struct
from threading import Lock
from typing import Any

from cmsreduce.errors import CmsReduceError, ReadError, refuse_device

__all__ = [
    "HEADERS",
    "LIBRARY_ERRORS",
    "FileBytes",
    "check_included",
    "files_read",
    "is_med",
    "is_text",
    "read_head",
    "read_lines",
    "read_text",
    "reading",
    "refuse_rewritten",
    "require_file",
    "sha256_of",
]

LIBRARY_ERRORS = (
    # scipy, h5py, zipfile and pyYeti trust the sizes, types and offsets in a file, so that one wrong byte can raise any
    # of these. A failed assertion or an unknown name is a fault of this program and is not among them.
    struct.error,
    tokenize.TokenError,
    zlib.error,
    zipfile.BadZipFile,
    ValueError,
    TypeError,
    LookupError,
    OSError,
    EOFError,
    ArithmeticError,
    MemoryError,
    NotImplementedError,
    AttributeError,
    RuntimeError,
)
"""Readers of binary formats raise any of these when a file is damaged; none is a message for an engineer."""

HEADERS = Lock()
"""For files of numpy, whose headers Python parses: it counts the depth of its parser for all threads together, so that
two at once may end in an error (CPython 3.11)."""

_READ: ContextVar[dict[Path, str] | None] = ContextVar("files_read", default=None)


@contextmanager
def files_read() -> Iterator[dict[Path, str]]:
    """Collect all files that are read while the block lasts, included ones and lists too: absolute path and hash.

    Raises
    ------
    ReadError
        If one of them has another content at the end, whatever was read from it.
    """
    found: dict[Path, str] = {}
    token = _READ.set(found)
    try:
        yield found
    except CmsReduceError:
        # What was wrong may be that the file was half written.
        refuse_rewritten(found)
        raise
    finally:
        _READ.reset(token)
    refuse_rewritten(found)


def refuse_rewritten(files: Mapping[Path, str]) -> None:
    """Refuse files that have another content than that of a hash.

    Raises
    ------
    ReadError
        With the first of them.
    """
    for path, content in files.items():
        if not path.is_file() or sha256_of(path) != content:
            raise ReadError(
                f"{path}: changed while this run read it, and nothing made of it is kept. Let the program that writes "
                "it end, and run again"
            )


def _record(path: Path) -> None:
    """Note that a file is about to be opened; a device or a pipe is refused, also where a deck includes it."""
    refuse_device(path)
    if (found := _READ.get()) is not None and path.absolute() not in found and path.is_file():
        # The reader says what keeps it from being opened.
        with suppress(ReadError):
            found[path.absolute()] = sha256_of(path)


# Bytes of a file that are read together.
_AT_ONCE = 4_000_000
# Files that include one another; more would exceed the stack of Python.
_DEEPEST = 50
# A file that was changed less than a second ago may change again without a new time.
_SETTLED_NS = 10**9
_HDF5 = b"\x89HDF\r\n\x1a\n"
# Control characters that text has none of: all but tabs, ends of lines and pages, and the end of a DOS file.
_DOS_END = b"\x1a"
_NO_TEXT = bytes(set(range(32)) - set(b"\t\n\r\f" + _DOS_END))


@contextmanager
def reading(path: Path, content: str) -> Iterator[None]:
    """Turn a library's exception on a damaged file into a ReadError.

    Parameters
    ----------
    path : Path
        File being read.
    content : str
        The part being read, such as ``the OP4 matrix 'KAA'``.

    Raises
    ------
    ReadError
        In place of the library's exception.
    """
    try:
        yield
    except LIBRARY_ERRORS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ReadError(
            f"{path}: {content} cannot be read: {reason}. The file ({path.stat().st_size} bytes) is truncated or "
            "damaged: write it again, or copy it again in binary mode"
        ) from error


def check_included(path: Path, chain: tuple[Path, ...]) -> None:
    """Check a file that the last of a chain of files includes, each of them included by the one before.

    Raises
    ------
    ReadError
        If it is one of them, or they are too many.
    """
    if path.resolve() in [p.resolve() for p in chain]:
        raise ReadError(f"{path} includes itself: {' -> '.join(str(p) for p in (*chain, path))}")
    if len(chain) > _DEEPEST:
        raise ReadError(
            f"{path}: it is included by {chain[-1].name}, which is included in turn, {len(chain)} files deep; at most "
            f"{_DEEPEST} are read: write the innermost ones into the files that include them"
        )


def require_file(path: Path) -> None:
    """Check that a file exists and is not empty.

    Raises
    ------
    ReadError
        If it is missing (with the nearest name in its folder), a folder, unreadable or empty.
    """
    if not path.exists():
        if path.is_symlink():
            raise ReadError(f"{path}: is a link to a file that is not there; the link names {path.readlink()}")
        folder = path.parent
        names = [item.name for item in folder.iterdir()] if folder.is_dir() else []
        near = difflib.get_close_matches(path.name, names, n=1)
        hint = (
            f", did you mean {folder / near[0]}?"
            if near
            else ""
            if folder.is_dir()
            else f"; there is no folder {folder}"
        )
        if "\\" in path.name:
            hint = "; it is a path of Windows: write it with /, best relative to the file that names it"
        raise ReadError(f"{path}: there is no such file{hint}")
    if path.is_dir():
        raise ReadError(f"{path}: is a folder, not a file; name the file in it")
    refuse_device(path)
    if not read_head(path, 1):
        raise ReadError(f"{path}: the file is empty; the run that should have written it may have failed")


def read_head(path: Path, count: int, subject: str = "") -> bytes:
    """First bytes of a file.

    Parameters
    ----------
    path : Path
        The file.
    count : int
        Bytes to read at most.
    subject : str
        Start of the message if that fails; by default the path.

    Raises
    ------
    ReadError
        If the file cannot be opened.
    """
    _record(path)
    try:
        with path.open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise ReadError(f"{subject or f'{path}:'} cannot be read: {error.strerror or error}") from error


def is_text(head: bytes) -> bool:
    """True for bytes of plain text."""
    return len(head.translate(None, _NO_TEXT)) == len(head)


def is_med(path: Path) -> bool:
    """True for an HDF5 file that holds meshes of MED (Salome, code_aster, gmsh)."""
    if not read_head(path, len(_HDF5)).startswith(_HDF5):
        return False
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return "ENS_MAA" in file
    except LIBRARY_ERRORS:
        # A reader says what is damaged.
        return False


def read_text(path: Path, subject: str = "") -> str:
    """Text of a file, as UTF-8; other bytes become replacement characters. Parameters and error as of ``read_head``.

    A text that is marked as UTF-16, as a shell of Windows writes it, is read as that.
    """
    _record(path)
    try:
        with path.open("rb") as file:
            wide = file.read(2) in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        text = path.read_text(encoding="utf-16" if wide else "utf-8-sig", errors="replace")
        return text.rstrip(_DOS_END.decode())
    except OSError as error:
        raise ReadError(f"{subject or f'{path}:'} cannot be read: {error.strerror or error}") from error


class FileBytes:
    """Bytes of a file, a few at a time; it is not mapped, because a mapped file that is cut ends the process.

    Parameters
    ----------
    path : Path
        The file; its size is that of now.

    Raises
    ------
    EOFError
        When bytes are asked for that the file does not have any more.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._size, self._start, self._block = path, path.stat().st_size, 0, b""

    def __len__(self) -> int:
        return self._size

    def __getitem__(self, part: slice) -> bytes:
        start, stop, _ = part.indices(self._size)
        stop = max(start, stop)
        at = self._at(start, stop - start)
        return self._block[at : at + stop - start]

    def unpack(self, numbers: Struct, start: int) -> tuple[Any, ...]:
        """Numbers that begin at a byte."""
        at = self._at(start, numbers.size)
        return numbers.unpack_from(self._block, at)

    def _at(self, start: int, count: int) -> int:
        """Place of some bytes in the block that is held, which is read where it lacks them."""
        at = start - self._start
        if at < 0 or at + count > len(self._block):
            with self._path.open("rb") as file:
                file.seek(start)
                self._start, self._block, at = start, file.read(max(count, _AT_ONCE)), 0
            if len(self._block) < count:
                raise EOFError(f"it had {self._size} bytes, and those from {start} on are gone")
        return at


def read_lines(path: Path) -> bytes:
    """Bytes of a text, whose lines end with a newline whatever the system that wrote it; no marks of UTF-8 and DOS."""
    _record(path)
    text = path.read_bytes().removeprefix(codecs.BOM_UTF8).rstrip(_DOS_END)
    return text.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in text else text


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes, in hexadecimal.

    Raises
    ------
    ReadError
        If the file cannot be read.
    """
    try:
        state = Path(path).stat()
        # A copy may carry the time of another file's writing.
        changed = max(state.st_mtime_ns, state.st_ctime_ns)
        if time.time_ns() - changed < _SETTLED_NS:
            return _sha256(Path(path))
        return _sha256_of_state(Path(path).absolute(), state.st_size, changed, state.st_ino)
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error


@lru_cache(maxsize=1000)
def _sha256_of_state(path: Path, size: int, changed: int, inode: int) -> str:
    """Hash of a file that does not change any more: a run asks for it in several places."""
    return _sha256(path)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
