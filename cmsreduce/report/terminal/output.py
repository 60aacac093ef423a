"""Output of a command: progress as bars or lines, results on standard output, as JSON and in a log file."""

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
from cmsreduce.report.wording import plural

if TYPE_CHECKING:
    from rich.console import Console
    from rich.progress import Progress as Bars

__all__ = ["Bar", "Lines", "Output", "Several", "opened_output", "print_line", "standard_console", "watch"]

# Seconds without a line after which a long step reports its progress.
_SILENT_S = 10.0
# Seconds without a line after which the next piece of work gets a line: a short run is not told step by step.
_SPACED_S = 2.0
# Columns where there is no terminal.
_PLAIN_WIDTH = 100


class Lines:
    """Plain lines on the pieces of work, with the time since the start.

    Parameters
    ----------
    stream : text stream
        Receives the lines.
    clock : callable
        Seconds.
    every : bool
        True for a line for every piece of work; else for the first one, and for those that begin some seconds after the
        line before.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.perf_counter, *, every: bool = True) -> None:
        self.stream, self.clock, self.every = stream, clock, every
        self.started = self.begun = self.last_line = clock()
        self.current = ""

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work."""
        first, self.begun = not self.current, self.clock()
        self.current = f"{stage:<13} {what}"
        if self.every or first or self.begun - self.last_line >= _SPACED_S:
            self._write(self.current)

    def reused(self, stage: str, what: str) -> None:
        """Take a finished piece of work from an earlier run."""
        if self.every:
            self._write(f"{stage:<13} {what} (finished before, reused)")

    def advance(self, done: int, total: int) -> None:
        """Write the progress of a long piece of work, with the time left, at most every ten seconds."""
        now = self.clock()
        if 0 < done < total and now - self.last_line >= _SILENT_S:
            left = (now - self.begun) * (total - done) / done
            self._write(f"{self.current}: {done} of {total}, about {left:.0f} s left")

    def note(self, text: str) -> None:
        """Write a note."""
        self._write(f"note: {text}")

    def _write(self, text: str) -> None:
        self.last_line = self.clock()
        self.stream.write(f"{self.last_line - self.started:8.2f} s  {text}\n")
        self.stream.flush()


class Bar:
    """A bar that moves on a terminal, for the piece of work that is being done.

    Parameters
    ----------
    bars : rich.progress.Progress
        Started.
    every : bool
        True if the bars of finished work stay.
    """

    def __init__(self, bars: Bars, *, every: bool = True) -> None:
        self.bars, self.every = bars, every
        self.current: Any = None

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work; the one before it is finished."""
        self.finish()
        self.current = self.bars.add_task(f"{stage} {what}", total=None)

    def reused(self, stage: str, what: str) -> None:
        """Take a finished piece of work from an earlier run."""
        self.stage(stage, f"{what} (reused)")

    def advance(self, done: int, total: int) -> None:
        """Move the bar."""
        self.bars.update(self.current, completed=done, total=total)

    def note(self, text: str) -> None:
        """Print a note above the bars."""
        self.bars.console.print(f"note: {text}", markup=False, highlight=False)

    def finish(self) -> None:
        """Fill the bar of the last piece of work, or take it away."""
        if self.current is not None and self.every:
            task = self.bars.tasks[-1]
            self.bars.update(self.current, total=task.total or 1, completed=task.total or 1)
        elif self.current is not None:
            self.bars.remove_task(self.current)
            self.current = None


class Several:
    """Progress on several outputs at once; none for a silent run.

    Parameters
    ----------
    listeners : sequence of Bar or Lines
        The outputs.
    later : Bar or Lines, optional
        The one whose notes are held back for the end.
    """

    def __init__(self, listeners: Sequence[Bar | Lines], later: Bar | Lines | None = None) -> None:
        self.listeners, self.later = listeners, later
        self.held: list[str] = []

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work."""
        for each in self.listeners:
            each.stage(stage, what)

    def reused(self, stage: str, what: str) -> None:
        """Take a finished piece of work from an earlier run."""
        for each in self.listeners:
            each.reused(stage, what)

    def advance(self, done: int, total: int) -> None:
        """Report the progress of the current piece of work."""
        for each in self.listeners:
            each.advance(done, total)

    def note(self, text: str) -> None:
        """Report a note."""
        for each in self.listeners:
            if each is not self.later:
                each.note(text)
        self.held.append(text)

    def release(self) -> None:
        """Report the notes that were held back."""
        if self.later is not None:
            for text in self.held:
                self.later.note(text)


@contextmanager
def watch(*, every: bool = True) -> Iterator[Bar | Lines]:
    """Show the progress of a run on standard error: bars on a terminal, lines elsewhere.

    Standard output holds results only.

    Parameters
    ----------
    every : bool
        True if every piece of work leaves a line.
    """
    if not sys.stderr.isatty():
        yield Lines(sys.stderr, every=every)
    else:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn

        columns = (
            SpinnerColumn(),
            TextColumn("{task.description}"),
            BarColumn(bar_width=24),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=Console(stderr=True)) as bars:
            bar = Bar(bars, every=every)
            yield bar
            bar.finish()


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
            print(json.dumps(_finite(data), indent=2, allow_nan=False))


@contextmanager
def opened_output(*, quiet: bool, as_json: bool, log_file: Path | None, verbose: bool = False) -> Iterator[Output]:
    """Open the log; an error that ends the command is written into it.

    Raises
    ------
    WriteError
        If the log cannot be written.
    """
    if log_file is None:
        yield Output(quiet=quiet, as_json=as_json, verbose=verbose)
        return
    try:
        log_file.parent.mkdir(parents=True, exist_ok=True)
        # A path may hold bytes that are no letters.
        log = log_file.open("w", encoding="utf-8", errors="backslashreplace")
    except OSError as error:
        raise WriteError(f"--log-file {log_file}: the log cannot be written: {error.strerror or error}") from None
    with log:
        output = Output(quiet=quiet, as_json=as_json, log=log, verbose=verbose)
        try:
            yield output
        except CmsReduceError as error:
            log.write(f"error: {error}\n")
            raise
        except KeyboardInterrupt:
            log.write("interrupted\n")
            raise


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


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value
