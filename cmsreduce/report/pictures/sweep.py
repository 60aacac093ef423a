"""The picture of a sweep: error against cost, as SVG, and as a page with a choice of both."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError
from cmsreduce.model import SweepResult, SweepRow, short_keys
from cmsreduce.report.page import embedded, packed_plotly, part
from cmsreduce.report.palette import INK, LIMIT, LineStyle, model_style
from cmsreduce.report.pareto import COSTS, Trade, trades
from cmsreduce.report.pictures.figure import MARKERS, drawn, literal
from cmsreduce.report.wording import FIGURES, number, plural

__all__ = ["sweep_page", "sweep_picture"]

_INCHES = (11.0, 4.2)
_ERROR = "relative response error"
# Costs of the still picture; the page has all.
_STILL = ("n_reduced", "operations", "reduce_s", "reduced_frf_s")
# Scripts of the page, in the order in which they depend on each other.
_SCRIPTS = ("page_inflate", "page_arrays", "page_style", "sweep_page")
# Opacity of points off the front.
_FAINT = 0.35
# Styles for groups of points.
_MOST_GROUPS = 6


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
                    marks: Any = {"marker": MARKERS[look.symbol], "color": look.colour, "s": 34 if best else 18}
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
    """Any error against any cost, and a table of all points, as one HTML page that opens offline.

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
        "styles": {"ink": INK, "limit": LIMIT},
        "faint": _FAINT,
        "planes": planes,
        "limits": _limits(sweep),
        "groups": [{"name": name, **asdict(look)} for name, look in _groups(sweep).items()],
        "group": {row.point: list(_groups(sweep)).index(_group(sweep, row)) for row in sweep.rows},
        "folders": {row.point: f"{row.folder}/" for row in sweep.rows},
        "said": {row.point: _tooltip(row) for row in sweep.rows},
        "labels": {figure.name: f"{figure.label}, {figure.unit}" for figure in FIGURES} | COSTS,
    }
    page = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True).from_string(part("sweep.html.j2"))
    there = {name for plane in planes for name in (plane["error"], plane["cost"])}
    failed, broken = sweep.count("failed"), sweep.count("limit broken")
    counts = [plural(len(sweep.rows), "point"), *([f"{broken} broke a limit"] if broken else [])]
    heads, rows = _table(sweep)
    return page.render(
        name=sweep.name,
        word=sweep.word,
        counts=", ".join([*counts, *([f"{failed} failed"] if failed else [])]),
        title=_title(sweep),
        heads=heads,
        rows=rows,
        errors=[(figure.name, figure.label) for figure in FIGURES if figure.name in there],
        costs=[(name, label) for name, label in COSTS.items() if name in there],
        program=sweep.provenance.get("program", "cmsreduce"),
        data=Markup(embedded(data)),
        plotly=Markup(packed_plotly()),
        style=Markup(part("page.css")),
        script=Markup("\n".join(part(f"{name}.js") for name in _SCRIPTS)),
    )


def _limits(sweep: SweepResult) -> dict[str, dict[str, Any]]:
    """Limits that all points share, in the units shown."""
    given = sweep.provenance.get("settings_of_first_point", {}).get("verify") or {}
    limits = given.get("limits") or {}
    return {
        figure.name: {"value": figure.scale * limit, "text": f"limit {figure.text(limit)}"}
        for figure in FIGURES
        if (limit := limits.get(figure.name)) and f"verify.limits.{figure.name}" not in sweep.axes
    }


def _table(sweep: SweepResult) -> tuple[list[dict[str, Any]], list[list[dict[str, Any]]]]:
    """Headings and rows of all points; an empty value stays last when the rows are sorted."""
    keys = short_keys(list(sweep.axes))
    figures = [figure for figure in FIGURES if any(math.isfinite(getattr(row, figure.name)) for row in sweep.rows)]
    costs = {name: label for name, label in COSTS.items() if any(getattr(row, name) > 0 for row in sweep.rows)}
    heads = [
        {"label": "point", "num": True},
        *({"label": key, "num": False} for key in keys),
        {"label": "kept", "num": True},
        *({"label": figure.label, "num": True} for figure in figures),
        *({"label": label, "num": True} for label in costs.values()),
        {"label": "outcome", "num": False},
    ]
    rows = []
    for row in sweep.rows:
        done = row.status != "failed"
        cells = [_cell(row.point, str(row.point), f"{row.folder}/" if done else "")]
        cells += [_cell(row.overrides[key]) for key in sweep.axes]
        cells.append(_cell(row.kept_modes if done else math.nan))
        cells += [_cell(value, figure.text(value)) for figure in figures for value in [getattr(row, figure.name)]]
        cells += [_cell(float(getattr(row, name) or math.nan)) for name in costs]
        rows.append([*cells, _cell(f"{row.status}: {row.message}" if row.message else row.status)])
    return heads, rows


def _cell(value: str | float, text: str | None = None, link: str = "") -> dict[str, Any]:
    if isinstance(value, str):
        return {"value": value, "text": value, "link": link}
    if math.isnan(value):
        return {"value": "", "text": "–", "link": link}
    return {"value": repr(float(value)), "text": number(value) if text is None else text, "link": link}


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
