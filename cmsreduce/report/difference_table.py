"""Two runs beside each other on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from cmsreduce.report.wording import number

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["DIFFERENCE_WIDTH", "print_difference"]

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
