"""Charts as files: PNG, SVG, PDF."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from cmsreduce.report.palette import INK, LIMIT
from cmsreduce.report.pictures.chart import Chart, Series
from cmsreduce.report.pictures.figure import MARKERS, drawn, legend_above, line_of, literal, plain_axes

__all__ = ["draw_chart"]

# Labels on an axis of names, and those above which they are turned.
_MOST_NAMES, _TURNED = 14, 4


def draw_chart(chart: Chart, path: Path) -> None:
    """Draw a chart into a file; its suffix says the format."""
    with drawn(path, chart.inches) as figure:
        heights = [panel.height for panel in chart.panels]
        rows = figure.subplots(len(chart.panels), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0]
        middle = _middle(chart)
        for series in sorted(chart.series, key=lambda each: each.ahead):
            _draw(rows[series.panel], series, middle)
        if chart.x_log:
            rows[0].set_xscale("log")
        for axes, panel in zip(rows, chart.panels, strict=True):
            axes.set(ylabel=panel.label)
            if panel.log:
                axes.set_yscale("log")
            if panel.limit is not None:
                value, words = panel.limit
                at: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
                axes.axhline(value, color=LIMIT, linewidth=0.8)
                axes.annotate(literal(words), (0, value), (4, 3), color=LIMIT, **at)
            if panel.range is not None:
                axes.set_ylim(*panel.range)
            if panel.ticks:
                axes.set_yticks(panel.ticks)
        if chart.x_range is not None:
            rows[-1].set_xlim(*chart.x_range)
        elif not chart.x_log and not chart.shades:
            rows[-1].margins(x=0.1)
        rows[0].set_title(literal(chart.title), loc="left", pad=22 if chart.legend and chart.title else 6)
        rows[-1].set_xlabel(literal(chart.x_label))
        if chart.shades is not None:
            _shade(figure, rows[0], chart)
            return
        for axes, panel in zip(rows, chart.panels, strict=True):
            plain_axes(axes, x="log" if chart.x_log and axes is rows[-1] else "", y="log" if panel.log else "")
        if chart.x_names:
            turned = len(chart.x_names) > _TURNED
            names = [literal(name) for name in chart.x_names]
            rows[-1].set_xticks(
                range(len(names)), names, rotation=30 if turned else 0, ha="right" if turned else "center"
            )
        if chart.legend:
            legend_above(figure, rows[0], chart.legend)
        figure.align_ylabels()


def _middle(chart: Chart) -> float:
    """Place from which names of marks stand on the left."""
    places = [float(series.x[0]) for series in chart.series if series.kind == "named mark"]
    return (min(places) + max(places)) / 2 if places else math.nan


def _draw(axes: Any, series: Series, middle: float) -> None:
    look, label = series.look, literal(series.label) if series.label else None
    line: Any = {**line_of(look), "label": label}
    mark: Any = {"marker": MARKERS[look.symbol], "linestyle": "", "color": look.colour, "label": label}
    x, y = series.x, series.y
    if series.kind == "line":
        axes.plot(x, y, **line)
    elif series.kind == "steps":
        axes.step(x, y, where="post", **line)
    elif series.kind == "line and mark":
        axes.plot(x, y, **line, marker=MARKERS[look.symbol], markersize=5)
    elif series.kind == "bar":
        axes.bar(x, y, color=look.colour, label=label)
    elif series.kind == "open bar":
        axes.bar(x, y, color="white", edgecolor="#8c959f", hatch="////", label=label)
    elif series.kind == "circle":
        axes.plot(x, y, "o", mfc="none", mec=look.colour)
    else:
        axes.plot(x, y, markersize=14 if look.symbol == "star" else 7, **mark)
    if series.kind == "named mark":
        right = x[0] <= middle
        place: Any = {"textcoords": "offset points", "ha": "left" if right else "right"}
        # A limit must not strike out a name.
        place["bbox"] = {"facecolor": "white", "edgecolor": "none", "pad": 0.5}
        own = look.symbol == "star"
        axes.annotate(label, (x[0], y[0]), (8 if right else -8, 5), color=INK if own else look.colour, **place)


def _shade(figure: Any, axes: Any, chart: Chart) -> None:
    shades = chart.shades
    assert shades is not None
    image = axes.imshow(
        shades.values, origin="lower", cmap="Blues", vmin=0, vmax=1, aspect="auto", interpolation="nearest"
    )
    for axis, names in ((axes.xaxis, shades.columns), (axes.yaxis, shades.rows)):
        step = max(1, math.ceil(len(names) / _MOST_NAMES))
        axis.set_ticks(range(0, len(names), step), names[::step])
    axes.tick_params(axis="x", rotation=50)
    figure.colorbar(image, ax=axes, label=shades.label)
