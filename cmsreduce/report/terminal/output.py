"""Output of a command: results on standard output, as JSON and in a log file."""

from __future__ import annotations

import io
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

from cmsreduce.errors import CmsReduceError, WriteError
from cmsreduce.report.terminal.progress import Lines, Several, watch
from cmsreduce.report.wording import plural

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["Output", "opened_output", "plain_data", "print_line", "standard_console"]

# Columns where there is no terminal.
_PLAIN_WIDTH = 100


class Output:
    """Output of one command.

    Parameters
    ----------
    quiet : bool
        Print nothing but errors and failures.
    as_json : bool
        Print the result as JSON, and nothing else, on standard output.
    log : text stream, optional
        Holds everything, whatever is printed.
    verbose : bool
        Print every piece of work, table and note.
    """

    def __init__(
        self, *, quiet: bool = False, as_json: bool = False, log: TextIO | None = None, verbose: bool = False
    ) -> None:
        self.quiet, self.as_json, self.log, self.verbose = quiet, as_json, log, verbose
        self.started = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Wall time since the command began."""
        return time.perf_counter() - self.started

    @property
    def shows(self) -> bool:
        """True if words go to standard output."""
        return not (self.quiet or self.as_json)

    @contextmanager
    def watch(self, *, notes: bool = True) -> Iterator[Several]:
        """Show progress on the terminal and in the log.

        Parameters
        ----------
        notes : bool
            Print notes as they come; false for a command that ends with them. They are printed where it fails.
        """
        logged = [] if self.log is None else [Lines(self.log)]
        if self.quiet:
            yield Several(logged)
            return
        with watch(every=self.verbose) as shown:
            every = Several([shown, *logged], None if notes or self.verbose else shown)
            try:
                yield every
            except BaseException:
                every.release()
                raise

    def consoles(self, width: int = _PLAIN_WIDTH, *, whole: bool = False) -> Iterator[Console]:
        """Consoles for tables: standard output and the log.

        Parameters
        ----------
        width : int
            Columns where there is no terminal.
        whole : bool
            True if rows keep this width on a terminal, too; the terminal wraps them.
        """
        from rich.console import Console

        if self.shows:
            yield standard_console(width, wrapped_by_terminal=whole)
        if self.log is not None:
            yield Console(file=self.log, width=width, soft_wrap=whole, no_color=True, force_terminal=False)

    def rows(self, lines: Iterable[tuple[str, bool]], drawn: Callable[[Console], None]) -> None:
        """Print lines, or a table of them on a terminal; the log holds the lines.

        Parameters
        ----------
        lines : iterable of (str, bool)
            Each line, with True if a quiet command prints it, too.
        drawn : callable
            Prints the table.
        """
        terminal = self.shows and sys.stdout.isatty()
        if terminal:
            for console in Output(quiet=self.quiet, as_json=self.as_json).consoles():
                drawn(console)
        for text, important in lines:
            self.line(text, important=important, logged_only=terminal)

    def made(self, files: Sequence[Path], *, where: Path | None = None, about: str = "") -> None:
        """Print the names of written files, and a last line with their count, their folder, the result and the time."""
        for path in files:
            self.line(f"wrote {path}")
        count = plural(len(files), "file")
        found = f"{count} in {self.seconds:.1f} s"
        if where is not None:
            found = "; ".join([f"{count} in {where}", *([about] if about else []), f"{self.seconds:.1f} s"])
        self.line(found)

    def line(self, text: str, *, important: bool = False, logged_only: bool = False) -> None:
        """Print one line; a quiet command prints it if it is important."""
        if (self.shows and not logged_only) or (important and not (self.as_json or logged_only)):
            _replace_unknown_letters(sys.stdout)
            print(text)
        if self.log is not None:
            self.log.write(f"{text}\n")

    def result(self, data: Any) -> None:
        """Print the result as JSON if the command has this option; numbers that are not finite are null."""
        if self.as_json:
            print(json.dumps(plain_data(data), indent=2, allow_nan=False))


@contextmanager
def opened_output(*, quiet: bool, as_json: bool, log_file: Path | None, verbose: bool = False) -> Iterator[Output]:
    """Open the log; an error that ends the command is written into it.

    Raises
    ------
    WriteError
        If the log cannot be opened, or, when the command has done its work, if lines of it were lost.
    """
    if log_file is None:
        yield Output(quiet=quiet, as_json=as_json, verbose=verbose)
        return
    try:
        log_file.parent.mkdir(parents=True, exist_ok=True)
        file = _LogFile(log_file, "w")
    except OSError as error:
        raise WriteError(f"--log-file {log_file}: the log cannot be written: {error.strerror or error}") from None
    # A path may hold bytes that are no letters.
    with io.TextIOWrapper(io.BufferedWriter(file), "utf-8", "backslashreplace") as log:
        output, left = Output(quiet=quiet, as_json=as_json, log=log, verbose=verbose), None
        try:
            yield output
        except CmsReduceError as error:
            log.write(f"error: {error}\n")
            raise
        except KeyboardInterrupt:
            log.write("interrupted\n")
            raise
        except SystemExit as error:
            left = error
    if file.fault is not None:
        raise WriteError(
            f"--log-file {log_file}: the log is not complete: {file.fault.strerror or file.fault}; the command did all "
            "else. Free space, or choose another disk"
        )
    if left is not None:
        raise left


class _LogFile(io.FileIO):
    """File on a disk that may become full: no run is lost for it, and the first error is kept."""

    fault: OSError | None = None

    def write(self, data: Any, /) -> int:
        """Write, or lose what does not fit."""
        try:
            return super().write(data) or 0
        except OSError as error:
            self.fault = self.fault or error
            return len(memoryview(data).cast("B"))

    def close(self) -> None:
        """Close; some disks say only here that they are full."""
        try:
            super().close()
        except OSError as error:
            self.fault = self.fault or error


def standard_console(width: int = _PLAIN_WIDTH, *, wrapped_by_terminal: bool = False) -> Console:
    """Console on standard output, plain and of a given width where that is no terminal."""
    from rich.console import Console

    _replace_unknown_letters(sys.stdout)
    if sys.stdout.isatty() and not wrapped_by_terminal:
        return Console()
    return Console(width=width, soft_wrap=wrapped_by_terminal)


def print_line(console: Console, text: str, style: str = "") -> None:
    """Print one line, wrapped by the terminal itself, so that a path can be copied whole."""
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def _replace_unknown_letters(stream: TextIO) -> None:
    if isinstance(stream, io.TextIOWrapper):
        # A name that the terminal's encoding lacks must not end a finished run.
        stream.reconfigure(errors="replace")


def plain_data(value: Any) -> Any:
    """Values as JSON has them: numbers that are not finite are null, paths are texts."""
    if isinstance(value, dict):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain_data(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
