"""Progress of a run: plain lines, or bars on a terminal, one piece of work after another."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

__all__ = ["Bar", "Lines", "Several", "watch"]

# Seconds without a line after which a long step reports its progress.
_SILENT_S = 10.0
# Seconds without a line after which the next piece of work gets a line: a short run is not told step by step.
_SPACED_S = 2.0


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
