"""Tables on the terminal: one mechanism, and the tables of inspected files, differences of runs and rankings."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Finding, HealthFinding, ModalComponent, SensitivityRecord
from cmsreduce.report.terminal.output import Output, standard_console
from cmsreduce.report.wording import CLOSE_MODES, number

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column, Table
    from rich.text import Text

__all__ = [
    "DIFFERENCE_WIDTH",
    "InspectedLine",
    "RANKINGS_WIDTH",
    "check_line",
    "figures",
    "health_lines",
    "print_difference",
    "print_inspected",
    "print_rankings",
    "ranking_rows",
    "table",
    "verdict",
    "words",
]

Figure = float | int | str | bool | None

DIFFERENCE_WIDTH = 120
"""Columns of the table of differences where there is no terminal."""

RANKINGS_WIDTH = 150
"""Columns of the widest table of rankings; a narrower terminal wraps it and loses nothing."""

# Blanks between two columns, and before and after the rows of a table with edges.
_GAP = 3
# Width of verdict and edges in the table of an inspected file.
_BESIDE_NAMES = 14
# Width of a name before figures in columns.
_NAME_WIDTH = 44
# Colours of verdicts.
_VERDICTS = {"pass": "green", "PASS": "green", "FAIL": "bold red", "info": "dim"}


def words(head: str = "", **more: Any) -> Column:
    """Column of text, folded where it is long."""
    from rich.table import Column
    from rich.text import Text

    return Column(Text(head), overflow="fold", **more)


def figures(head: str = "") -> Column:
    """Column of numbers, on the right and never folded."""
    from rich.table import Column
    from rich.text import Text

    return Column(Text(head), justify="right", no_wrap=True)


def verdict(text: str) -> Text:
    """A verdict in its colour."""
    from rich.text import Text

    return Text(text, _VERDICTS.get(text, ""))


def table(
    columns: Iterable[Column],
    rows: Iterable[Sequence[str | Text]],
    *,
    title: str = "",
    heads: bool = True,
    edges: bool = True,
) -> Table:
    """Make a table of plain text, in which brackets are no markup; an empty row ends a section.

    A table without ``edges`` has no empty line above and below it.
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    made = Table(
        *columns,
        box=box.SIMPLE_HEAD if heads else box.SIMPLE,
        show_header=heads,
        show_edge=edges,
        pad_edge=False,
        title=Text(title, "" if heads else "bold") if title else None,
        title_justify="left",
    )
    for row in rows:
        if row:
            made.add_row(*(Text(cell) if isinstance(cell, str) else cell for cell in row))
        else:
            made.add_section()
    return made


def narrowed(
    columns: Sequence[Column], rows: Sequence[Sequence[str]], width: int, left_out: Iterable[int]
) -> tuple[list[Column], list[list[str]]]:
    """Columns and rows of a table, without some columns if they do not fit side by side.

    Parameters
    ----------
    columns : sequence of Column
        One that has a least width may be folded to it.
    rows : sequence of sequence of str
        Cells.
    width : int
        Letters of a line.
    left_out : iterable of int
        Columns to do without, the first one first.

    Returns
    -------
    columns : list of Column
    rows : list of list of str
        Those that are shown.
    """
    cells = zip(*(([""] * len(columns)), *rows), strict=True)
    widths = [
        column.min_width or max(map(len, (str(column.header), *texts)))
        for column, texts in zip(columns, cells, strict=True)
    ]
    shown = list(range(len(columns)))
    for k in left_out:
        if sum(widths[j] + _GAP for j in shown) > width + 1:
            shown.remove(k)
    return [columns[k] for k in shown], [[row[k] for k in shown] for row in rows]


@dataclass(frozen=True)
class InspectedLine:
    """One line on an inspected file.

    Parameters
    ----------
    text : str
        The content.
    name : str
        Subject of the text; empty for a sentence.
    verdict : {"", "pass", "FAIL"}
        Of a check.
    depth : int
        Level below the first line.
    in_columns : bool
        True for a row of figures in a block of such rows.
    """

    text: str
    name: str = ""
    verdict: str = ""
    depth: int = 0
    in_columns: bool = False

    @property
    def line(self) -> str:
        """The line for a log."""
        before = "  " * self.depth + (f"{self.verdict}  " if self.verdict else "")
        if self.in_columns:
            return f"{before + self.name:<{_NAME_WIDTH}} {self.text}"
        return before + (f"{self.name}: {self.text}" if self.name else self.text)


def check_line(check: Finding) -> InspectedLine:
    """Value, limit and verdict of a check of a body."""
    return InspectedLine(f"{number(check.value, 3)} (limit {number(check.limit, 3)})", check.name, check.verdict)


def health_lines(health: Iterable[HealthFinding]) -> list[InspectedLine]:
    """The table of a body's health; a limit that is not met is followed by the advice."""
    return [InspectedLine(found.words + ("" if found.passed else f" ({found.advice})"), found.name) for found in health]


def print_inspected(rows: Sequence[InspectedLine], output: Output) -> None:
    """Print the content of one file: a table on a terminal, lines in a log."""
    output.rows([(row.line, False) for row in rows], lambda console: console.print(_inspected(rows, console.width)))


def _inspected(rows: Sequence[InspectedLine], width: int) -> Table:
    title, *rest = rows
    cells = [(verdict(row.verdict), "  " * (row.depth - 1) + row.name, row.text) for row in rest]
    # Names fold sooner than rows of figures.
    left = width - _BESIDE_NAMES - max((len(row.text) for row in rest if row.in_columns), default=0)
    return table((words(), words(max_width=max(left, 1)), words()), cells, title=title.text.rstrip(":"), heads=False)


def print_difference(
    names: tuple[str, str],
    rows: Iterable[tuple[str, Figure, Figure, float | None]],
    same: int,
    console: Console | None = None,
) -> None:
    """Print the figures that differ between two runs.

    Parameters
    ----------
    names : (str, str)
        The two runs.
    rows : iterable of (str, figure, figure, float or None)
        Name, value in either run, and relative change.
    same : int
        Number of equal figures.
    console : rich.console.Console, optional
        Standard output by default.
    """
    console = console or standard_console(DIFFERENCE_WIDTH)
    cells = [
        (name, _shown(a), _shown(b), "" if change is None else f"{100 * change:+.3g} %") for name, a, b, change in rows
    ]
    if cells:
        console.print(table((words(), *(words(name, justify="right") for name in names), figures("change")), cells))
    console.print(f"{len(cells)} figures differ, {same} are the same", highlight=False)


def _shown(value: Figure) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return number(value, 6)
    return "-" if value is None else str(value)


def print_rankings(
    components: Mapping[str, ModalComponent],
    selection: Mapping[str, NDArray[np.int64]],
    console: Console | None = None,
    sensitivity: SensitivityRecord | None = None,
    scaling: Mapping[str, str] | None = None,
) -> None:
    """Print the rankings of every ranked body.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        All modes.
    selection : mapping of name to (k,) int64
        Elastic columns that are kept.
    console : rich.console.Console, optional
        Standard output by default.
    sensitivity : SensitivityRecord, optional
        Names the modes on the edge.
    scaling : mapping of body to str, optional
        Scaling of inputs and outputs, printed below.
    """
    console = console or standard_console(RANKINGS_WIDTH, wrapped_by_terminal=True)
    for name, component in components.items():
        if not component.rankings:
            continue
        edge = () if sensitivity is None else sensitivity.edge(name)
        heads = ("mode", "Hz", "cluster", "", "", *_shown_rankings(component))
        rows = ranking_rows(component, np.asarray(selection[name]), edge)
        console.print(table(map(figures, heads), rows, title=f"{name}: coefficient and place"))
        if scaling and scaling.get(name):
            console.print(f"{name}: {scaling[name]}", markup=False, highlight=False, soft_wrap=True)


def ranking_rows(
    component: ModalComponent, kept: NDArray[np.int64], edge: Collection[int] = ()
) -> list[tuple[str, ...]]:
    """One row per elastic mode, in order of frequency.

    Parameters
    ----------
    component : ModalComponent
        With its rankings.
    kept : (k,) int64
        Columns that are kept.
    edge : collection of int
        Numbers of the modes on the edge.

    Returns
    -------
    list of tuple of str
        Number, frequency in Hz, number of the cluster or nothing, ``close`` where the next mode is within ten
        half-power widths, ``kept`` or nothing, and ``edge`` for a mode on the edge; then for each ranking the
        coefficient and the place, 1 for the most important.
    """
    e, chosen = component.elastic, set(kept.tolist())
    columns = []
    for name in _shown_rankings(component):
        values = component.rankings[name]
        order = np.argsort(-values[e], kind="stable")
        place = np.empty(order.size, dtype=np.int64)
        place[order] = np.arange(1, order.size + 1)
        columns.append([f"{number(float(v), 3)}  {p}" for v, p in zip(values[e], place, strict=True)])
    return [
        (
            str(k + 1),
            number(float(component.omega[k]) / (2 * np.pi), 5),
            "" if component.cluster is None or not component.cluster[k] else str(component.cluster[k]),
            "close" if component.spacing[k] > CLOSE_MODES else "",
            " ".join((["kept"] if k in chosen else []) + (["edge"] if k + 1 in edge else [])),
            *(column[k - e.start] for column in columns),
        )
        for k in range(e.start, e.stop)
    ]


def _shown_rankings(component: ModalComponent) -> list[str]:
    # The ranking by frequency holds the period, which the row shows as its frequency.
    return [name for name in component.rankings if name != "frequency"]
