"""Progress of a run: a bar on a terminal, plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress as Bars

__all__ = ["Bar", "Lines", "Several", "watch"]

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
        from rich.progress import (
            BarColumn,
            Progress,
            SpinnerColumn,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

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
