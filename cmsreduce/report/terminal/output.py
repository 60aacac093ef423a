"""Progress of a run: a bar on a terminal, plain lines in a log.

Where a command says what it found: standard output, as JSON, a log file, or nowhere.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress as Bars
import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from cmsreduce.errors import CmsReduceError, WriteError
from cmsreduce.report.wording import plural

if TYPE_CHECKING:
    from rich.console import Console

__all__ = [
    "Bar",
    "Lines",
    "Output",
    "Several",
    "opened_output",
    "watch",
]

Listener = TypeVar("Listener")

# A step that has said nothing for so many seconds says how far it is.
_PATIENCE = 10.0


class Lines:
    """One plain line per piece of work, with the time since the start.

    Parameters
    ----------
    stream : text stream
        Where lines go.
    clock : callable
        Seconds.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.perf_counter) -> None:
        self.stream, self.clock = stream, clock
        self.started = self.begun = self.said = clock()
        self.current = ""

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work."""
        self._say(f"{stage:<13} {what}")
        self.begun, self.current = self.said, f"{stage:<13} {what}"

    def reused(self, stage: str, what: str) -> None:
        """Take a finished piece of work from an earlier run."""
        self._say(f"{stage:<13} {what} (finished before, reused)")

    def advance(self, done: int, total: int) -> None:
        """Say how far a long piece of work is, and how long it still takes; a log needs no more motion."""
        now = self.clock()
        if 0 < done < total and now - self.said >= _PATIENCE:
            left = (now - self.begun) * (total - done) / done
            self._say(f"{self.current}: {done} of {total}, about {left:.0f} s left")

    def note(self, text: str) -> None:
        """Say what the reader must know."""
        self._say(f"note: {text}")

    def _say(self, text: str) -> None:
        self.said = self.clock()
        self.stream.write(f"{self.said - self.started:8.2f} s  {text}\n")
        self.stream.flush()


class Bar:
    """A bar that moves on a terminal, one for each piece of work.

    Parameters
    ----------
    bars : rich.progress.Progress
        Started.
    """

    def __init__(self, bars: Bars) -> None:
        self.bars = bars
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
        """Print above the bars."""
        self.bars.console.print(f"note: {text}", markup=False, highlight=False)

    def finish(self) -> None:
        """Fill the bar of the work just done."""
        if self.current is not None:
            task = self.bars.tasks[-1]
            self.bars.update(self.current, total=task.total or 1, completed=task.total or 1)


class Several:
    """Everything told to several listeners.

    Parameters
    ----------
    listeners : sequence of Bar or Lines
        None of them hears nothing, and says nothing.
    """

    def __init__(self, listeners: Sequence[Bar | Lines]) -> None:
        self.listeners = listeners

    def stage(self, stage: str, what: str) -> None:
        """Begin a piece of work."""
        for each in self.listeners:
            each.stage(stage, what)

    def reused(self, stage: str, what: str) -> None:
        """Take a finished piece of work from an earlier run."""
        for each in self.listeners:
            each.reused(stage, what)

    def advance(self, done: int, total: int) -> None:
        """Report how far the current piece of work is."""
        for each in self.listeners:
            each.advance(done, total)

    def note(self, text: str) -> None:
        """Report something the reader must know."""
        for each in self.listeners:
            each.note(text)


@contextmanager
def watch(listener: Listener | None = None) -> Iterator[Listener | Bar | Lines]:
    """Listen to a run: with the listener given, with bars on a terminal, with lines elsewhere.

    Progress goes to standard error, so that standard output holds results only.
    """
    if listener is not None:
        yield listener
    elif not sys.stderr.isatty():
        yield Lines(sys.stderr)
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
            bar = Bar(bars)
            yield bar
            bar.finish()


# Columns where there is no terminal to ask.
_PLAIN_WIDTH = 100


class Output:
    """What one command says.

    Parameters
    ----------
    quiet : bool
        Say nothing but errors, and what is asked for as JSON.
    as_json : bool
        Give the result as JSON on standard output, and nothing else there.
    log : text stream, optional
        Told everything, whatever is shown.
    """

    def __init__(self, *, quiet: bool = False, as_json: bool = False, log: TextIO | None = None) -> None:
        self.quiet, self.as_json, self.log = quiet, as_json, log
        self.started = time.perf_counter()

    @property
    def seconds(self) -> float:
        """Wall time since the command began."""
        return time.perf_counter() - self.started

    @property
    def shows(self) -> bool:
        """Whether words go to standard output."""
        return not (self.quiet or self.as_json)

    @contextmanager
    def watch(self) -> Iterator[Several]:
        """Listen to the work: as the terminal allows, and in the log."""
        logged = [] if self.log is None else [Lines(self.log)]
        if self.quiet:
            yield Several(logged)
            return
        with watch() as shown:
            assert isinstance(shown, (Bar, Lines))
            yield Several([shown, *logged])

    def consoles(self, width: int = _PLAIN_WIDTH, *, whole: bool = False) -> Iterator[Console]:
        """Where tables are printed.

        Parameters
        ----------
        width : int
            Columns where there is no terminal.
        whole : bool
            Whether rows keep that width on a terminal, too, which wraps them itself.
        """
        from rich.console import Console

        if self.shows:
            _forgive(sys.stdout)
            narrow = sys.stdout.isatty() and not whole
            yield Console() if narrow else Console(width=width, soft_wrap=whole)
        if self.log is not None:
            yield Console(file=self.log, width=width, soft_wrap=whole, no_color=True, force_terminal=False)

    def rows(self, lines: Iterable[tuple[str, bool]], drawn: Callable[[Console], None]) -> None:
        """Say lines, or draw them where there is a terminal; the log holds the lines.

        Parameters
        ----------
        lines : iterable of (str, bool)
            Each with whether it is said quietly, too.
        drawn : callable
            Draws them all on a terminal.
        """
        terminal = self.shows and sys.stdout.isatty()
        if terminal:
            for console in Output(quiet=self.quiet, as_json=self.as_json).consoles():
                drawn(console)
        for text, important in lines:
            self.line(text, important=important, logged_only=terminal)

    def made(self, files: Sequence[Path], *, where: Path | None = None, about: str = "") -> None:
        """Name the files that were written, and end with how many, where, what they tell, and the time."""
        for path in files:
            self.line(f"wrote {path}")
        count = plural(len(files), "file")
        found = f"{count} in {self.seconds:.1f} s"
        if where is not None:
            found = "; ".join([f"{count} in {where}", *([about] if about else []), f"{self.seconds:.1f} s"])
        self.line(found)

    def line(self, text: str, *, important: bool = False, logged_only: bool = False) -> None:
        """Say one line; one that is important is said quietly, too."""
        if (self.shows and not logged_only) or (important and not (self.as_json or logged_only)):
            _forgive(sys.stdout)
            print(text)
        if self.log is not None:
            self.log.write(f"{text}\n")

    def result(self, data: Any) -> None:
        """Give the result as JSON, if that is asked for; what is not finite is null."""
        if self.as_json:
            print(json.dumps(_finite(data), indent=2, allow_nan=False))


@contextmanager
def opened_output(*, quiet: bool, as_json: bool, log_file: Path | None) -> Iterator[Output]:
    """Open the log, and write into it what ends the command.

    Raises
    ------
    WriteError
        If the log cannot be written.
    """
    if log_file is None:
        yield Output(quiet=quiet, as_json=as_json)
        return
    try:
        log_file.parent.mkdir(parents=True, exist_ok=True)
        log = log_file.open("w", encoding="utf-8")
    except OSError as error:
        raise WriteError(f"--log-file {log_file}: the log cannot be written: {error.strerror or error}") from None
    with log:
        output = Output(quiet=quiet, as_json=as_json, log=log)
        try:
            yield output
        except CmsReduceError as error:
            log.write(f"error: {error}\n")
            raise
        except KeyboardInterrupt:
            log.write("interrupted\n")
            raise


def _forgive(stream: TextIO) -> None:
    import io

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
