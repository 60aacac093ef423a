"""Progress in a log, and on a terminal."""

import io

from rich.console import Console

from cmsreduce.report.terminal.progress import Bar, Lines, Several, watch


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_long_step_says_how_long_it_still_takes() -> None:
    stream, clock = io.StringIO(), Clock()
    lines = Lines(stream, clock)
    lines.stage("verify", "system")
    for done in range(1, 9):
        clock.now = 4.0 * done
        lines.advance(done, 8)
    # Every tenth second or later: at 12 s with 3 of 8, five to go at 4 s each; not at the end, which is said anyway.
    assert stream.getvalue().splitlines() == [
        "    0.00 s  verify        system",
        "   12.00 s  verify        system: 3 of 8, about 20 s left",
        "   24.00 s  verify        system: 6 of 8, about 8 s left",
    ]


def test_a_quick_step_says_nothing_more() -> None:
    stream, clock = io.StringIO(), Clock()
    lines = Lines(stream, clock)
    lines.stage("assemble", "system")
    lines.advance(1, 2)
    assert len(stream.getvalue().splitlines()) == 1


def test_several_hear_the_same_and_none_is_silent() -> None:
    streams = io.StringIO(), io.StringIO()
    clock = Clock()
    both = Several([Lines(stream, clock) for stream in streams])
    for listener in (both, Several([])):
        listener.stage("reduce", "arm")
        listener.reused("reduce", "panel")
        listener.advance(1, 1)
        listener.note("look")
    assert streams[0].getvalue() == streams[1].getvalue()
    assert "note: look" in streams[0].getvalue()


def test_a_terminal_shows_the_time_left(monkeypatch) -> None:
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    stream.isatty = lambda: True
    monkeypatch.setattr("rich.console.Console", lambda **_: Console(file=stream, force_terminal=True, width=100))
    with watch() as bar:
        assert isinstance(bar, Bar)
        bar.stage("verify", "system")
        bar.advance(1, 4)
        columns = [type(column).__name__ for column in bar.bars.columns]
    assert "TimeRemainingColumn" in columns
    assert "verify system" in stream.getvalue() and "left" in stream.getvalue()
