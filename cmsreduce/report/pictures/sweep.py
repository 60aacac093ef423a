"""The picture of a sweep: error against cost, as SVG and as an interactive page."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError
from cmsreduce.model import SweepResult, SweepRow
from cmsreduce.report.page import embedded, packed_plotly, part
from cmsreduce.report.palette import INK, LineStyle, model_style
from cmsreduce.report.pareto import Trade, trades
from cmsreduce.report.pictures.figure import drawn, literal
from cmsreduce.report.wording import number, plural

__all__ = ["sweep_page", "sweep_picture"]

_INCHES = (11.0, 4.2)
_ERROR = "relative response error"
# Opacity of points off the front.
_FAINT = 0.35
# Styles for groups of points.
_MOST_GROUPS = 6
_MARKERS = {"circle": "o", "square": "s", "diamond": "D", "triangle-up": "^", "triangle-down": "v", "cross": "P"}


def sweep_picture(sweep: SweepResult, path: Path) -> None:
    """Draw error against every cost, with a line along the Pareto front; other points are faint.

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

    found, groups = _trades(sweep, path), _groups(sweep)
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
    """The same picture as one HTML page that opens offline; each point has a tooltip.

    Raises
    ------
    WriteError
        If no point has an error to draw.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup
    from plotly.graph_objects import Scatter
    from plotly.subplots import make_subplots

    found = _trades(sweep, Path("sweep.html"))
    figure = make_subplots(rows=1, cols=len(found), shared_yaxes=True, horizontal_spacing=0.03)
    shown: set[str] = set()
    for column, trade in enumerate(found, 1):
        place: Any = {"row": 1, "col": column}
        front = {"x": trade.x[trade.steps].tolist(), "y": trade.y[trade.steps].tolist()}
        line: Any = {"line": {"color": INK, "width": 1, "shape": "hv"}, "hoverinfo": "skip"}
        figure.add_trace(Scatter(**front, mode="lines", name="Pareto front", showlegend=column == 1, **line), **place)
        for group, look in _groups(sweep).items():
            at = [k for k, row in enumerate(trade.rows) if _group(sweep, row) == group]
            best = [bool(trade.front[k]) for k in at]
            marker: Any = {
                "symbol": look.symbol,
                "color": look.colour,
                "size": [11 if b else 7 for b in best],
                "opacity": [1.0 if b else _FAINT for b in best],
                "line": {"color": INK, "width": [1 if b else 0 for b in best]},
            }
            figure.add_trace(
                Scatter(
                    x=trade.x[at].tolist(),
                    y=trade.y[at].tolist(),
                    mode="markers",
                    name=_escaped(group),
                    legendgroup=group,
                    showlegend=group not in shown,
                    text=[_tooltip(trade.rows[k]) for k in at],
                    hovertemplate="%{text}<extra></extra>",
                    marker=marker,
                ),
                **place,
            )
            shown.add(group)
        figure.update_xaxes(title_text=trade.label, type="log", gridcolor="#e4e8ec", **place)
    figure.update_yaxes(type="log", gridcolor="#e4e8ec", exponentformat="power")
    figure.update_yaxes(title_text=_ERROR, row=1, col=1)
    title = _escaped(_title(sweep))
    figure.update_layout(
        title_text=title, template="plotly_white", font_color=INK, legend={"orientation": "h", "y": -0.2}
    )
    page = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True).from_string(part("sweep.html.j2"))
    return page.render(
        title=_title(sweep),
        data=Markup(embedded(json.loads(figure.to_json()))),
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
    return "<br>".join(_escaped(line) for line in lines)


def _tick(value: float, _: int | None = None) -> str:
    """A few plain numbers of each decade."""
    leading = f"{value:.0e}"[0]
    return f"{value:g}" if leading in "1235" else ""


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")
