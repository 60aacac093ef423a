"""The picture of a sweep: error against cost, as SVG, and as a page with a choice of both."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError
from cmsreduce.model import SweepResult, SweepRow
from cmsreduce.report.page import embedded, packed_plotly, part
from cmsreduce.report.palette import INK, LineStyle, model_style
from cmsreduce.report.pareto import COSTS, Trade, trades
from cmsreduce.report.pictures.figure import drawn, literal
from cmsreduce.report.wording import FIGURES, number, plural

__all__ = ["sweep_page", "sweep_picture"]

_INCHES = (11.0, 4.2)
_ERROR = "relative response error"
# Costs of the still picture; the page has all.
_STILL = ("n_reduced", "operations", "reduce_s", "reduced_frf_s")
# Opacity of points off the front.
_FAINT = 0.35
# Styles for groups of points.
_MOST_GROUPS = 6
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "triangle-down": "v", "cross": "P"}


def sweep_picture(sweep: SweepResult, path: Path) -> None:
    """Draw the response error against the main costs, with a line along the Pareto front; other points are faint.

    Parameters
    ----------
    sweep : SweepResult
        With at least one point that has an error.
    path : Path
        File to write; its suffix says the format.

    Raises
    ------
    WriteError
        If no point has an error to draw.
    """
    from matplotlib.ticker import FuncFormatter

    found, groups = [trade for trade in _trades(sweep, path) if trade.cost in _STILL], _groups(sweep)
    with drawn(path, _INCHES) as figure:
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for axes, trade in zip(panels, found, strict=True):
            axes.step(trade.x[trade.steps], trade.y[trade.steps], where="post", color=INK, linewidth=0.9, zorder=1)
            for group, look in groups.items():
                here = [k for k, row in enumerate(trade.rows) if _group(sweep, row) == group]
                for best in (False, True):
                    at = [k for k in here if trade.front[k] == best]
                    marks: Any = {"marker": _MARKERS[look.symbol], "color": look.colour, "s": 34 if best else 18}
                    edge: Any = {"edgecolors": INK if best else "none", "linewidths": 0.7}
                    label = literal(group) if best else None
                    faint = 1.0 if best else _FAINT
                    axes.scatter(trade.x[at], trade.y[at], alpha=faint, label=label, zorder=2 + best, **marks, **edge)
            axes.set(xlabel=trade.label, xscale="log", yscale="log")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter(FuncFormatter(_tick))
                axis.set_minor_formatter(FuncFormatter(_tick))
            axes.grid(color="#e4e8ec", linewidth=0.6)
            axes.spines[["top", "right"]].set_visible(False)
        panels[0].set_ylabel(_ERROR)
        figure.suptitle(literal(_title(sweep)), x=0.01, ha="left", fontsize=10)
        if len(groups) > 1:
            handles, labels = panels[0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower center", ncols=len(groups), frameon=False)


def sweep_page(sweep: SweepResult) -> str:
    """Any error against any cost as one HTML page that opens offline; each point has a tooltip.

    Raises
    ------
    WriteError
        If no point has an error to draw.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    _trades(sweep, Path("sweep.html"))
    planes = [
        {
            "error": figure.name,
            "cost": trade.cost,
            "points": [row.point for row in trade.rows],
            "x": trade.x.tolist(),
            "y": (figure.scale * trade.y).tolist(),
            "front": trade.front.tolist(),
            "steps": trade.steps.tolist(),
            "noise": trade.noise,
        }
        for figure in FIGURES
        for trade in trades(sweep, figure.name)
    ]
    data = {
        "ink": INK,
        "faint": _FAINT,
        "planes": planes,
        "groups": [{"name": _escaped(name), **asdict(look)} for name, look in _groups(sweep).items()],
        "group": {row.point: list(_groups(sweep)).index(_group(sweep, row)) for row in sweep.rows},
        "said": {row.point: _tooltip(row) for row in sweep.rows},
        "labels": {figure.name: f"{figure.label}, {figure.unit}" for figure in FIGURES} | COSTS,
    }
    page = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True).from_string(part("sweep.html.j2"))
    there = {name for plane in planes for name in (plane["error"], plane["cost"])}
    return page.render(
        title=_title(sweep),
        errors=[(figure.name, figure.label) for figure in FIGURES if figure.name in there],
        costs=[(name, label) for name, label in COSTS.items() if name in there],
        data=Markup(embedded(data)),
        plotly=Markup(packed_plotly()),
        script=Markup("\n".join([part("page_arrays.js"), part("sweep_page.js")])),
    )


def _trades(sweep: SweepResult, path: Path) -> tuple[Trade, ...]:
    found = trades(sweep)
    if not found:
        raise WriteError(f"{path}: no point of the sweep has an error to draw; the pipeline needs `verify:`")
    return found


def _title(sweep: SweepResult) -> str:
    failed = sweep.count("failed")
    rest = f", {failed} failed" if failed else ""
    return f"{sweep.name}: error against speed, {plural(len(sweep.rows), 'point')}{rest}"


def _groups(sweep: SweepResult) -> dict[str, LineStyle]:
    """Values of the first key that has several, with the style of each."""
    key = _group_key(sweep)
    values = sweep.axes[key] if key else ("",)
    return {f"{key}={value}" if key else "points": model_style(k) for k, value in enumerate(values)}


def _group(sweep: SweepResult, row: SweepRow) -> str:
    key = _group_key(sweep)
    return f"{key}={row.overrides[key]}" if key else "points"


def _group_key(sweep: SweepResult) -> str | None:
    return next((key for key, values in sweep.axes.items() if 1 < len(values) <= _MOST_GROUPS), None)


def _tooltip(row: SweepRow) -> str:
    lines = [f"point {row.point}: {row.status}", *(f"{key} = {value}" for key, value in row.overrides.items())]
    lines.append(f"response error {number(row.frf_error)}, {number(row.db_error)} dB, {row.kept_modes} modes kept")
    lines.append(
        f"{row.n_reduced} coordinates, reduction {number(row.reduce_s)} s, responses {number(row.reduced_frf_s)} s"
    )
    if math.isfinite(row.operations):
        lines.append(f"{number(row.steps_per_second)} steps and {number(row.operations)} operations a simulated second")
    return "<br>".join(_escaped(line) for line in lines)


def _tick(value: float, _: int | None = None) -> str:
    """A few plain numbers of each decade."""
    leading = f"{value:.0e}"[0]
    return f"{value:g}" if leading in "1235" else ""


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
