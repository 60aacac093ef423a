"""Two runs beside each other on the terminal.

What was found in a file: a table on a terminal, lines in a log.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from cmsreduce.report.wording import number

if TYPE_CHECKING:
    from rich.console import Console
import re
from collections.abc import Sequence

from cmsreduce.report.terminal.output import Output

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "DIFFERENCE_WIDTH",
    "print_difference",
    "print_inspected",
]

DIFFERENCE_WIDTH = 120
"""Columns in a log or a pipe."""

Figure = float | int | str | bool | None


def print_difference(
    names: tuple[str, str],
    rows: Iterable[tuple[str, Figure, Figure, float | None]],
    same: int,
    console: Console | None = None,
) -> None:
    """Print what differs, and how much.

    Parameters
    ----------
    names : (str, str)
        The two runs.
    rows : iterable of (str, figure, figure, float or None)
        What, its value in either run, and the relative change.
    same : int
        Figures that are equal.
    console : rich.console.Console, optional
        Standard output by default.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    if console is None:
        console = Console() if sys.stdout.isatty() else Console(width=DIFFERENCE_WIDTH)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("")
    for name in names:
        table.add_column(Text(name), justify="right", overflow="fold")
    table.add_column("change", justify="right", no_wrap=True)
    for what, a, b, change in rows:
        table.add_row(Text(what), _shown(a), _shown(b), "" if change is None else f"{100 * change:+.3g} %")
    if table.row_count:
        console.print(table)
    console.print(f"{table.row_count} figures differ, {same} are the same", highlight=False)


def _shown(value: Figure) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value, 6)
    return "-" if value is None else str(value)


_VERDICTS = {"pass": "green", "FAIL": "bold red"}
# A longer text before a colon is a sentence, not the name of what follows.
_LONGEST_NAME = 50
# A name, and figures in columns after it.
_NUMBERS = re.compile(r"(.*?\S) {2,}(-?[\d.]+(?: +-?[\d.]+)+)")


def print_inspected(lines: Sequence[str], output: Output) -> None:
    """Say what was found in one file."""
    output.rows([(line, False) for line in lines], lambda console: console.print(inspection_table(lines)))


def inspection_table(lines: Sequence[str]) -> Table:
    """What each line is about beside what it says; a check has its verdict before it.

    Parameters
    ----------
    lines : sequence of str
        The first names the file; what belongs together is indented alike.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    title, *rest = lines
    table = Table(
        box=box.SIMPLE, pad_edge=False, show_header=False, title=Text(title.rstrip(":"), "bold"), title_justify="left"
    )
    table.add_column("", no_wrap=True)
    table.add_column("", overflow="fold", style="bold")
    table.add_column("", overflow="fold")
    width = 0
    for line in rest:
        verdict, name, text = _cells(line.strip())
        # Numbers stand below the heads that a line before them gave.
        width = len(text) if text.startswith(" ") else width
        text = text.rjust(width) if _NUMBERS.fullmatch(line.strip()) else text
        indent = " " * max(0, len(line) - len(line.lstrip()) - 2)
        table.add_row(Text(verdict, _VERDICTS.get(verdict, "")), Text(indent + name), Text(text))
    return table


def _cells(words: str) -> tuple[str, str, str]:
    """Verdict of a check, what a line is about, and what it says; empty what it has not."""
    verdict, _, more = words.partition("  ")
    if verdict in _VERDICTS:
        # A name may have a colon of its own.
        name, _, value = more.rpartition(": ")
        return verdict, name, value
    if row := _NUMBERS.fullmatch(words):
        return "", row[1], row[2]
    name, colon, text = words.partition(": ")
    return ("", name, text) if colon and len(name) <= _LONGEST_NAME else ("", "", words)
