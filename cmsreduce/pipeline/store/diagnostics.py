"""Diagnostics fail alone: one mechanism that names what failed, keeps the reason, and lets the run go on.

Only reading, reducing and assembling stop a run. Whatever else a run does is a function with the decorator
`diagnostic`: checks, comparisons, drawings, tables, files of other programs.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import asdict
from functools import wraps
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import Failure
from cmsreduce.write import LOG_MARK

__all__ = ["DIAGNOSTICS", "Failures", "collecting", "diagnostic", "report_failures"]

P = ParamSpec("P")
T = TypeVar("T")

DIAGNOSTICS: dict[str, Callable[..., Any]] = {}
"""Every diagnostic by its name; tests replace one to let it fail."""

# Longest reason that is shown on one line; the log of failures has the whole text.
_LONGEST = 400


class Failures:
    """Failures of one run, in their order, each once.

    Parameters
    ----------
    note : callable, optional
        Called with a line about each failure.
    log : Path, optional
        File for the tracebacks of unexpected errors; removed with the first `clear`.
    """

    def __init__(self, note: Callable[[str], None] | None = None, log: Path | None = None) -> None:
        self.note, self.log = note, log
        self._found: dict[str, Failure] = {}

    def __iter__(self) -> Iterator[Failure]:
        return iter(tuple(self._found.values()))

    def __len__(self) -> int:
        return len(self._found)

    @property
    def broken(self) -> bool:
        """True if something that was asked for, or that every body must pass, failed."""
        return any(failure.required for failure in self)

    def data(self) -> list[dict[str, Any]]:
        """The failures as plain values."""
        return [asdict(failure) for failure in self]

    def add(self, failure: Failure, details: str = "") -> None:
        """Record a failure; a second one of the same name is the same."""
        if failure.what in self._found:
            return
        self._found[failure.what] = failure
        if self.note is not None:
            self.note(failure.line)
        if details and self.log is not None:
            # A log that cannot be written is no reason to stop.
            with suppress(OSError):
                self.log.parent.mkdir(parents=True, exist_ok=True)
                with self.log.open("a", encoding="utf-8", errors="backslashreplace") as stream:
                    # A log without this line is a file of the user.
                    stream.write("" if stream.tell() else LOG_MARK)
                    stream.write(f"{failure.line}\n{details}\n")

    def record(self, what: str, error: Exception, *, required: bool = False, limits: tuple[str, ...] = ()) -> None:
        """Record the error of a part that failed."""
        details = "" if isinstance(error, CmsReduceError) else "".join(traceback.format_exception(error))
        self.add(Failure(what, _reason(error), required, limits, type(error).__name__), details)

    def clear_log(self) -> None:
        """Remove the log of an earlier run."""
        if self.log is not None:
            with suppress(OSError):
                self.log.unlink(missing_ok=True)


_FAILURES: ContextVar[Failures | None] = ContextVar("failures", default=None)


@contextmanager
def collecting(failures: Failures | None = None) -> Iterator[Failures]:
    """Collect the failures of diagnostics while the block lasts; outside of such a block a diagnostic raises its error.

    Parameters
    ----------
    failures : Failures, optional
        Receives them; by default a new one.
    """
    collected = Failures() if failures is None else failures
    token = _FAILURES.set(collected)
    try:
        yield collected
    finally:
        _FAILURES.reset(token)


def report_failures(failures: Iterable[Failure]) -> None:
    """Report failures of another process, or of a stage that was finished before, to the block that collects them."""
    collected = _FAILURES.get()
    if collected is not None:
        for failure in failures:
            collected.add(failure)


def diagnostic(
    name: str,
    otherwise: Callable[[], Any] = lambda: None,
    *,
    about: Callable[..., str] | None = None,
    required: bool = False,
    limits: tuple[str, ...] = (),
    passes: tuple[type[Exception], ...] = (),
    whole: bool = False,
) -> Callable[[Callable[P, T]], Callable[P, T]]:
    """Make a function a diagnostic: if it fails in a run, its failure is recorded by name, and the run goes on.

    Parameters
    ----------
    name : str
        Noun with its article, such as ``the drawing of '{}'`` with a place for the result of ``about``.
    otherwise : callable, optional
        Gives the result of a function that failed; None by default.
    about : callable, optional
        Takes the arguments, gives the name of the body, configuration or file.
    required : bool
        A failure is a failed run: the pipeline asks for the result by name, or every body must pass the check.
    limits : tuple of str
        Limits that are not measured without the result.
    passes : tuple of exception types
        Errors that stop the run all the same.
    whole : bool
        True if a diagnostic that fails within this one is a failure of this one.

    Notes
    -----
    Every `Exception` is caught, because a run of hours must not be lost to a fault in a drawing. The traceback of an
    error that is not the package's own goes to the log of failures.
    """

    def decorated(work: Callable[P, T]) -> Callable[P, T]:
        DIAGNOSTICS[name] = work

        @wraps(work)
        def attempted(*args: P.args, **named: P.kwargs) -> T:
            failures = _FAILURES.get()
            if failures is None:
                return DIAGNOSTICS[name](*args, **named)  # type: ignore[no-any-return]
            token = _FAILURES.set(None if whole else failures)
            try:
                return DIAGNOSTICS[name](*args, **named)  # type: ignore[no-any-return]
            # See the notes of `diagnostic`: errors of any class.
            except Exception as error:
                if isinstance(error, passes):
                    raise
                what = name if about is None else name.format(about(*args, **named))
                failures.record(what, error, required=required, limits=limits)
                return otherwise()  # type: ignore[no-any-return]
            finally:
                _FAILURES.reset(token)

        return attempted

    return decorated


def _reason(error: Exception) -> str:
    """Message of an error on one line, with its class if the error is not the package's own."""
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError):
        text = f"not enough memory{': ' if text else ''}{text}"
    elif not isinstance(error, CmsReduceError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]} ..."
