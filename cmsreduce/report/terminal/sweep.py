"""A sweep on the terminal: one table, and what was made."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cmsreduce.model import SweepResult, SweepRow, short_keys
from cmsreduce.report.pareto import trades
from cmsreduce.report.wording import FIGURES, plural, seconds

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["SWEEP_WIDTH", "print_sweep", "sweep_data"]

_SHOWN = FIGURES[:3]
SWEEP_WIDTH = 160
"""Columns in a log or a pipe."""
# Those that a value of a swept key may take before it is folded.
_WIDEST = 32


def print_sweep(sweep: SweepResult, files: Sequence[Path], console: Console | None = None) -> None:
    """Print a row for each point, those on a Pareto front marked.

    Parameters
    ----------
    sweep : SweepResult
    files : sequence of Path
        What was written, named at the end.
    console : rich.console.Console, optional
        Standard output by default.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    if console is None:
        console = Console() if sys.stdout.isatty() else Console(width=SWEEP_WIDTH)
    best = {row.point for trade in trades(sweep) for row, front in zip(trade.rows, trade.front, strict=True) if front}
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", justify="right", no_wrap=True)
    for key, values in zip(short_keys(list(sweep.axes)), sweep.axes.values(), strict=True):
        widest = min(max(len(value) for value in values), _WIDEST)
        table.add_column(Text(key), overflow="fold", min_width=widest, max_width=max(widest, len(key)))
    for name in ("kept", "size", *(figure.label.removesuffix(" error") for figure in _SHOWN), "reduce", "responses"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("", no_wrap=True)
    for row in sweep.rows:
        swept = [Text(row.overrides[key]) for key in sweep.axes]
        mark = "*" if row.point in best else " "
        verdict = {"passed": "PASS", "limit broken": "FAIL", "failed": "failed"}[row.status]
        table.add_row(f"{mark} {row.point}", *swept, *_cells(row), verdict)
    console.print(table)
    failed = [row for row in sweep.rows if row.status == "failed"]
    for message in dict.fromkeys(row.message for row in failed):
        points = [row.point for row in failed if row.message == message]
        _line(console, f"failed  {', '.join(map(str, points))}: {message}", "red")
    broken, good = sweep.count("limit broken"), sweep.count("passed")
    parts = [f"{good} passed", *([f"{broken} broke a limit"] if broken else [])]
    parts += [f"{len(failed)} failed"] if failed else []
    _line(console, f"{sweep.name}: {plural(len(sweep.rows), 'point')} in {seconds(sweep.seconds)}: {', '.join(parts)}")
    if best:
        _line(console, "* no other point has a smaller error at less cost in reduction time, size or response time")
    for file in files:
        _line(console, str(file))
    if files:
        _line(console, _ending(sweep, files))


def sweep_data(sweep: SweepResult, files: Sequence[Path]) -> dict[str, Any]:
    """A sweep as plain values: a row for each point, with whether it is on a Pareto front."""
    best = {row.point for trade in trades(sweep) for row, front in zip(trade.rows, trade.front, strict=True) if front}
    return {
        "name": sweep.name,
        "passed": sweep.passed,
        "axes": {key: list(values) for key, values in sweep.axes.items()},
        "points": [{**asdict(row), "pareto": row.point in best} for row in sweep.rows],
        "files": list(files),
        "seconds": sweep.seconds,
    }


def _ending(sweep: SweepResult, files: Sequence[Path]) -> str:
    """What was made and where, the errors reached, and the time."""
    figure = _SHOWN[0]
    errors = {row.point: row.frf_error for row in sweep.rows if math.isfinite(row.frf_error)}
    reached = "no point has a response error"
    if errors:
        worst, best = max(errors, key=errors.__getitem__), min(errors, key=errors.__getitem__)
        reached = f"worst {figure.label} {figure.text(errors[worst])} at point {worst}"
        reached += f", least {figure.text(errors[best])} at point {best}" if best != worst else ""
    made = f"{plural(len(files), 'file')} in {files[0].parent}"
    return f"{sweep.name}: {'PASS' if sweep.passed else 'FAIL'}; {made}; {reached}; {seconds(sweep.seconds)}"


def _cells(row: SweepRow) -> list[str]:
    if row.status == "failed":
        return [""] * (len(_SHOWN) + 4)
    figures = [getattr(row, figure.name) for figure in _SHOWN]
    errors = ["" if math.isnan(value) else figure.text(value) for figure, value in zip(_SHOWN, figures, strict=True)]
    times = ["" if math.isnan(value) else seconds(value) for value in (row.reduce_s, row.reduced_frf_s)]
    return [str(row.kept_modes), str(row.n_reduced) if row.n_reduced else "", *errors, *times]


def _line(console: Console, text: str, style: str = "") -> None:
    # Wrapped by the terminal itself, so that a path can be copied whole.
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)
