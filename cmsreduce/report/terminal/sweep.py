"""A sweep on the terminal: one table, and the written files."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cmsreduce.model import SweepResult, SweepRow, short_keys
from cmsreduce.report.pareto import WALL_NOISE, trades
from cmsreduce.report.terminal.output import print_line, standard_console
from cmsreduce.report.terminal.tables import figures, narrowed, table, words
from cmsreduce.report.wording import FIGURES, number, plural, seconds

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column

__all__ = ["SWEEP_WIDTH", "print_sweep", "sweep_data"]

SWEEP_WIDTH = 160
"""Columns where there is no terminal."""

_SHOWN = tuple(each for each in FIGURES if each.name in ("frf_error", "db_error", "frequency_error"))
# Columns that are left out where the screen is narrow, counted from the last key: times, frequency error, size,
# operations, decibel error.
_LEFT_OUT = (7, 6, 5, 2, 8, 4)
# Columns of a swept key's value, and of its name, before they are folded.
_WIDEST, _HEAD = 32, 8
_VERDICTS = {"passed": "PASS", "limit broken": "FAIL", "not checked": "not checked", "failed": "failed"}


def print_sweep(sweep: SweepResult, files: Sequence[Path], console: Console | None = None) -> None:
    """Print a row for each point, with a mark for those on a Pareto front.

    Parameters
    ----------
    sweep : SweepResult
    files : sequence of Path
        Written files, named at the end.
    console : rich.console.Console, optional
        Standard output by default.
    """
    console = console or standard_console(SWEEP_WIDTH)
    best = _best(sweep)
    keys = [_key_column(*each) for each in zip(short_keys(list(sweep.axes)), sweep.axes.values(), strict=True)]
    heads = (
        "kept",
        "size",
        *(figure.label.removesuffix(" error") for figure in _SHOWN),
        "reduce",
        "responses",
        "operations",
        "",
    )
    rows = [
        (
            f"{'*' if row.point in best else ' '} {row.point}",
            *(row.overrides[key] for key in sweep.axes),
            *_cells(row),
            _VERDICTS[row.status],
        )
        for row in sweep.rows
    ]
    shown = narrowed((figures(), *keys, *map(figures, heads)), rows, console.width, (len(keys) + k for k in _LEFT_OUT))
    console.print(table(*shown))
    failed = [row for row in sweep.rows if row.status == "failed"]
    for message in dict.fromkeys(row.message for row in failed):
        points = [row.point for row in failed if row.message == message]
        print_line(console, f"failed  {', '.join(map(str, points))}: {message}", "red")
    over_limit, good = sweep.count("limit broken"), sweep.count("passed")
    parts = [f"{good} passed", *([f"{over_limit} broke a limit"] if over_limit else [])]
    parts += [f"{len(failed)} failed"] if failed else []
    parts += [f"{mute} not checked (no limits)"] if (mute := sweep.count("not checked")) else []
    count = plural(len(sweep.rows), "point")
    print_line(console, f"{sweep.name}: {count} in {seconds(sweep.seconds)}: {', '.join(parts)}")
    if best:
        print_line(
            console,
            "* no other point has a smaller error at less cost: size, operations of a simulation, or time; times "
            f"within {WALL_NOISE:.0%} count as equal",
        )
    for file in files:
        print_line(console, str(file))
    if files:
        print_line(console, _ending(sweep, files))


def _key_column(key: str, values: Sequence[str]) -> Column:
    widest = min(max(len(value) for value in values), _WIDEST)
    return words(key, min_width=max(widest, min(len(key), _HEAD)), max_width=max(widest, len(key)))


def _best(sweep: SweepResult) -> set[int]:
    """Numbers of the points on a Pareto front."""
    return {row.point for trade in trades(sweep) for row, front in zip(trade.rows, trade.front, strict=True) if front}


def sweep_data(sweep: SweepResult, files: Sequence[Path]) -> dict[str, Any]:
    """A sweep as plain values: a row for each point; ``pareto`` marks those on a Pareto front."""
    best = _best(sweep)
    return {
        "name": sweep.name,
        "passed": sweep.passed,
        "verdict": sweep.word,
        "axes": {key: list(values) for key, values in sweep.axes.items()},
        "points": [{**asdict(row), "pareto": row.point in best} for row in sweep.rows],
        "files": list(files),
        "seconds": sweep.seconds,
    }


def _ending(sweep: SweepResult, files: Sequence[Path]) -> str:
    """Verdict, count and folder of the files, errors reached, and time."""
    figure = _SHOWN[0]
    errors = {row.point: row.frf_error for row in sweep.rows if math.isfinite(row.frf_error)}
    reached = "no point has a response error"
    if errors:
        worst, best = max(errors, key=errors.__getitem__), min(errors, key=errors.__getitem__)
        reached = f"worst {figure.label} {figure.text(errors[worst])} at point {worst}"
        reached += f", least {figure.text(errors[best])} at point {best}" if best != worst else ""
    made = f"{plural(len(files), 'file')} in {files[0].parent}"
    return f"{sweep.name}: {sweep.word}; {made}; {reached}; {seconds(sweep.seconds)}"


def _cells(row: SweepRow) -> list[str]:
    if row.status == "failed":
        return [""] * (len(_SHOWN) + 5)
    measured = [(figure, getattr(row, figure.name)) for figure in _SHOWN]
    errors = ["" if math.isnan(value) else figure.text(value) for figure, value in measured]
    times = ["" if math.isnan(value) else seconds(value) for value in (row.reduce_s, row.reduced_frf_s)]
    work = "" if math.isnan(row.operations) else number(row.operations, 3)
    return [str(row.kept_modes), str(row.n_reduced) if row.n_reduced else "", *errors, *times, work]
