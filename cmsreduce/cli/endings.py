"""End of a command: its exit code, one message, a crash file for a fault of the program, and patient streams."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import platform
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from cmsreduce.errors import CmsReduceError

__all__ = [
    "BAD_INPUT",
    "INTERNAL_ERROR",
    "INTERRUPTED",
    "LIMIT_BROKEN",
    "OK",
    "Ending",
    "check_memory",
    "ending_of",
    "patient_streams",
]

OK, LIMIT_BROKEN, BAD_INPUT, INTERNAL_ERROR, INTERRUPTED = 0, 1, 2, 70, 130
"""Exit codes. 70 is EX_SOFTWARE of sysexits.h; 130 is what a shell gives for Ctrl-C."""

# Words of libraries that run out of memory and raise another error than MemoryError.
_NO_MEMORY = ("cannot allocate memory", "can't start new thread", "unable to allocate", "failed to map segment")
# Bytes of address space that Python and its numerical libraries take with one thread.
_LEAST = 416 * 2**20
# Longest chain of causes that is searched.
_CHAIN = 20
_LIBRARIES = ("cmsreduce", "numpy", "scipy", "h5py", "click", "pydantic", "ruamel.yaml", "rich", "plotly", "meshio")


@dataclass(frozen=True)
class Ending:
    """End of a command that an error stopped.

    Parameters
    ----------
    code : int
        Exit code.
    message : str
        For the reader.
    kind : str
        Class of the error.
    crash_file : Path, optional
        File with the traceback.
    found : dict
        Parts of the result that were made before the error, as plain values.
    """

    code: int
    message: str
    kind: str
    crash_file: Path | None = None
    found: Mapping[str, Any] = field(default_factory=dict)

    @property
    def json(self) -> str:
        """The same as JSON, for a command with ``--json``."""
        facts = {"code": self.code, "kind": self.kind, "message": self.message}
        if self.crash_file is not None:
            facts["crash_file"] = str(self.crash_file)
        return json.dumps({"error": facts, **self.found}, indent=2)


def ending_of(error: BaseException, folder: Path | None = None, command: Sequence[str] = ()) -> Ending | None:
    """End of a command by an error.

    Parameters
    ----------
    error : BaseException
        The error.
    folder : Path, optional
        Run directory, for the crash file; without it the file is in the folder of temporary files.
    command : sequence of str
        The command with its arguments.

    Returns
    -------
    Ending or None
        None for an exit that is no error.
    """
    kind = type(error).__name__
    if isinstance(error, KeyboardInterrupt):
        return Ending(INTERRUPTED, "interrupted; finished stages are kept and reused by the next run", kind)
    if isinstance(error, CmsReduceError):
        return Ending(BAD_INPUT, f"error: {error}", kind)
    if _lacks_memory(error):
        remedy = "lower reduce.cutoff, set solver.memory, use fewer --jobs, or raise the limit of the shell (ulimit -v)"
        return Ending(BAD_INPUT, f"error: not enough memory; {remedy}", "MemoryError")
    if isinstance(error, OSError):
        where = f" ({error.filename})" if error.filename else ""
        return Ending(BAD_INPUT, f"error: {error.strerror or error}{where}", kind)
    if isinstance(error, Exception):
        return _crash(error, folder, command)
    return None


def check_memory() -> None:
    """Refuse to start under a limit of memory in which the numerical libraries do not load.

    Raises
    ------
    MemoryError
        Because OpenBLAS tries for ever to get its buffers.
    """
    try:
        import resource
    except ImportError:
        return
    allowed = resource.getrlimit(resource.RLIMIT_AS)[0]
    if allowed != resource.RLIM_INFINITY and allowed < _LEAST:
        raise MemoryError(f"{allowed} bytes of address space")


def _lacks_memory(error: BaseException) -> bool:
    found: BaseException | None = error
    for _ in range(_CHAIN):
        if found is None:
            return False
        words = str(found).lower()
        if isinstance(found, MemoryError) or (isinstance(found, OSError) and found.errno == errno.ENOMEM):
            return True
        if any(each in words for each in _NO_MEMORY):
            return True
        found = found.__cause__ or found.__context__
    return False


def _crash(error: Exception, folder: Path | None, command: Sequence[str]) -> Ending:
    """End by a fault of the program, with a crash file."""
    kind = type(error).__name__
    text = _crash_text(error, command)
    said = " ".join(str(error).split())
    message = f"error: internal error: {kind}{': ' if said else ''}{said}"
    for place in (folder, Path(tempfile.gettempdir())):
        if place is None or not place.is_dir():
            continue
        path = place / f"crash-{time.strftime('%Y%m%d-%H%M%S')}-{os.getpid()}.txt"
        try:
            path.write_text(text, encoding="utf-8", errors="backslashreplace")
        except OSError:
            continue
        remedy = "This is a fault of cmsreduce; please report it with the file"
        return Ending(INTERNAL_ERROR, f"{message}\n{remedy} {path}", kind, path)
    return Ending(
        INTERNAL_ERROR, f"{message}\nThis is a fault of cmsreduce; please report it with these lines\n{text}", kind
    )


def _crash_text(error: Exception, command: Sequence[str]) -> str:
    from importlib.metadata import PackageNotFoundError, version

    lines = [f"command: {' '.join(command)}", f"python: {sys.version}", f"platform: {platform.platform()}"]
    for name in _LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            lines.append(f"{name}: {version(name)}")
    return "\n".join([*lines, "", *traceback.format_exception(error)])


class _PatientFile(io.FileIO):
    """File whose reader may leave: what is written after that is lost, and the command goes on to its end."""

    def write(self, data: Any, /) -> int:
        """Write, or do nothing if nobody reads."""
        try:
            return super().write(data) or 0
        except BrokenPipeError:
            return len(memoryview(data).cast("B"))


@contextmanager
def patient_streams() -> Iterator[None]:
    """Let standard output and standard error bear a closed pipe, a closed descriptor and a narrow encoding.

    A run must not be lost because a pager was left, a terminal was closed, or the locale lacks a letter. Only the
    process's own streams are replaced, until the block ends.
    """
    _open_closed()
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = (_patient(stream, number) for number, stream in ((1, before[0]), (2, before[1])))
    try:
        yield
    finally:
        ours = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = before
        for mine, theirs in zip(ours, before, strict=True):
            if mine is not theirs:
                _finish(mine)


def _open_closed() -> None:
    """Open closed descriptors, so that no file of the run gets the number of a standard stream."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            with contextlib.suppress(OSError):
                opened = os.open(os.devnull, os.O_RDWR)
                if opened != number:
                    os.dup2(opened, number)
                    os.close(opened)


def _patient(stream: IO[str] | None, number: int) -> Any:
    if stream is not (sys.__stdout__ if number == 1 else sys.__stderr__):
        # Somebody else's stream, such as that of a test or a notebook.
        return stream
    encoding, line_buffering = "utf-8", number == 2
    if isinstance(stream, io.TextIOWrapper):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
        encoding, line_buffering = stream.encoding, stream.line_buffering
    elif stream is not None:
        return stream
    raw = io.BufferedWriter(_PatientFile(number, "wb", closefd=False))
    return io.TextIOWrapper(raw, encoding, "replace", line_buffering=line_buffering)


def _finish(stream: Any) -> None:
    """Write what is left; an error there must not pass for a whole output."""
    try:
        stream.flush()
    except OSError as error:
        with contextlib.suppress(OSError):
            os.write(2, f"error: the output cannot be written: {error.strerror or error}\n".encode())
        raise SystemExit(BAD_INPUT) from None
