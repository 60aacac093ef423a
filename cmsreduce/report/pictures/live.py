"""Charts in a notebook: figures of plotly."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cmsreduce.errors import SceneError, not_among, optional_library
from cmsreduce.model import BodyDrawing, ModalComponent, RunResult
from cmsreduce.report.palette import INK, LIMIT
from cmsreduce.report.pictures import charts
from cmsreduce.report.pictures.chart import Chart, Series

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

__all__ = ["Plots"]

_PIXELS_PER_INCH = 100
_GRID = "#e4e8ec"
_MODES = {"mark": "markers", "named mark": "markers+text", "circle": "markers", "line and mark": "lines+markers"}
# Largest motion of a drawn mode, as a share of the size of the body.
_SWING = 0.15


class Plots:
    """Plots of a run, as figures of plotly that can be changed further.

    Parameters
    ----------
    run : RunResult
        With its drawing.
    """

    def __init__(self, run: RunResult) -> None:
        self._run = run

    def bode(self, input: str | None = None, output: str | None = None, *, configuration: str | None = None) -> Figure:
        """Response from an actuator to a sensor with its error, full against reduced; by default the worst.

        Raises
        ------
        SceneError
            If there is no such actuator, sensor or configuration.
        """
        run = self._run
        at, (o, i) = run.worst_response
        i = i if input is None else _place("actuator", input, run.inputs)
        o = o if output is None else _place("sensor", output, run.outputs)
        return draw_live(charts.responses(run, self._configuration(configuration, at), (o, i)))

    def error_cost(self) -> Figure:
        """Worst response error of this model and of the compared ones against their sizes."""
        return draw_live(charts.error_against_cost(self._run))

    def mac(self, configuration: str | None = None) -> Figure:
        """MAC between the modes of the full and of the reduced system, by default where the error is largest."""
        run = self._run
        at = self._configuration(configuration, run.worst_response[0])
        errors = run.configurations[at].errors.get(run.model) if run.configurations else None
        if errors is None or errors.mac_matrix is None:
            raise SceneError("the run has no MAC to draw; its pipeline needs `verify:`")
        return draw_live(charts.mac(errors.mac_matrix, run.configurations[at].configuration.name))

    def ranking(self, body: str | None = None) -> Figure:
        """Influence coefficients of the modes of a body, by default of the first one."""
        parts = self._run.components
        return draw_live(charts.ranking(parts[_body(body, parts)]))

    def modes(self, body: str | None = None) -> Figure:
        """Modes of a body on its mesh; a menu chooses the mode."""
        drawing = self._run.drawing
        if drawing is None:
            raise SceneError("the run has no drawing of its bodies")
        name = _body(body, self._run.components)
        return _modes(drawing.bodies[name], self._run.components[name].modes)

    def _configuration(self, name: str | None, default: int) -> int:
        names = [each.configuration.name for each in self._run.configurations]
        return default if name is None else _place("configuration", name, names)

    def __repr__(self) -> str:
        return f"<Plots of {self._run.name}: bode, error_cost, mac, modes, ranking>"


def draw_live(chart: Chart) -> Figure:
    """Draw a chart as a figure of plotly."""
    go = optional_library("plotly.graph_objects", "plotly", "plots in Python")
    figure = go.Figure()
    count, gap = len(chart.panels), 0.05
    heights = np.array([panel.height for panel in chart.panels])
    heights = heights / heights.sum() * (1 - gap * (count - 1))
    top = 1.0
    layout: dict[str, Any] = {}
    for k, panel in enumerate(chart.panels):
        name = f"yaxis{k + 1}" if k else "yaxis"
        scale = {"type": "log", "exponentformat": "power"} if panel.log else {}
        shown = None if panel.range is None else (np.log10(panel.range) if panel.log else panel.range)
        layout[name] = {**_axis(panel.label), **scale, "domain": [max(0.0, top - heights[k]), top]}
        layout[name] |= {} if shown is None else {"range": [float(each) for each in shown]}
        layout[name] |= {"tickvals": list(panel.ticks)} if panel.ticks else {}
        top -= heights[k] + gap
        if panel.limit is not None:
            value, words = panel.limit
            at = {"yref": f"y{k + 1}" if k else "y"}
            figure.add_shape(type="line", xref="paper", x0=0, x1=1, y0=value, y1=value, line={"color": LIMIT}, **at)
            level = float(np.log10(value)) if panel.log else value
            figure.add_annotation(
                xref="paper", x=0, y=level, text=words, showarrow=False, xanchor="left", yanchor="bottom", **at
            )
    layout["xaxis"] = {**_axis(chart.x_label), "anchor": f"y{count}" if count > 1 else "y"}
    if chart.x_log:
        layout["xaxis"] |= {"type": "log"}
    if chart.x_range is not None:
        layout["xaxis"] |= {"range": [float(v) for v in (np.log10(chart.x_range) if chart.x_log else chart.x_range)]}
    if chart.x_names:
        layout["xaxis"] |= {"tickvals": list(range(len(chart.x_names))), "ticktext": list(chart.x_names)}
    if (shades := chart.shades) is not None:
        blue = [[0, "#ffffff"], [0.25, "#cfe1ef"], [0.6, "#5a9bc8"], [1, "#08306b"]]
        hover = "full %{y}<br>reduced %{x}<br>MAC %{z:.3f}<extra></extra>"
        # Numbers as places, so that equal frequencies keep their own rows.
        figure.add_heatmap(z=shades.values, zmin=0, zmax=1, colorscale=blue, hovertemplate=hover)
        for axis, names in (("xaxis", shades.columns), ("yaxis", shades.rows)):
            step = max(1, -(-len(names) // 16))
            layout[axis] |= {"tickvals": list(range(0, len(names), step)), "ticktext": list(names[::step])}
    for series in sorted(chart.series, key=lambda each: each.ahead):
        figure.add_trace(_trace(series))
    figure.update_layout(
        title=chart.title or None,
        height=_PIXELS_PER_INCH * chart.inches[1],
        barmode="overlay",
        paper_bgcolor="#fff",
        plot_bgcolor="#fff",
        font={"color": INK},
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom"},
        hovermode="x unified" if chart.x_log and count > 1 else "closest",
        **layout,
    )
    return figure


def _axis(label: str) -> dict[str, Any]:
    return {"title": {"text": label}, "gridcolor": _GRID, "linecolor": "#8c959f", "showline": True, "zeroline": False}


def _trace(series: Series) -> dict[str, Any]:
    look = series.look
    place = {"yaxis": f"y{series.panel + 1}"} if series.panel else {}
    shared = {"x": series.x, "y": series.y, "name": series.label, "showlegend": bool(series.label), **place}
    if series.kind in ("bar", "open bar"):
        filled = (
            {"color": look.colour}
            if series.kind == "bar"
            else {"color": "#fff", "line": {"color": "#8c959f", "width": 1}}
        )
        return {"type": "bar", **shared, "marker": filled}
    line = {
        "color": look.colour,
        "dash": look.dash,
        "width": look.width,
        "shape": "hv" if series.kind == "steps" else "linear",
    }
    symbol = f"{look.symbol}-open" if series.kind == "circle" else look.symbol
    named = {"text": [series.label], "textposition": "top center", "showlegend": False}
    return {
        "type": "scatter",
        **shared,
        "mode": _MODES.get(series.kind, "lines"),
        "line": line,
        "marker": {"color": look.colour, "symbol": symbol, "size": 11 if "mark" in series.kind else 8},
        **(named if series.kind == "named mark" else {}),
    }


def _modes(body: BodyDrawing, modes: ModalComponent) -> Figure:
    """Lines of a body at rest and in each mode, in space."""
    go = optional_library("plotly.graph_objects", "plotly", "plots in Python")
    lines = body.lines if len(body.lines) else np.column_stack([np.arange(len(body.xyz))] * 2)
    size = float(np.linalg.norm(np.ptp(body.xyz, axis=0)))
    gaps = np.full((len(lines), 1, 3), np.nan)

    def wires(points: Any) -> dict[str, Any]:
        x, y, z = np.concatenate([points[lines], gaps], axis=1).reshape(-1, 3).T
        return {"x": x, "y": y, "z": z}

    shown = {"type": "scatter3d", "mode": "lines", "hoverinfo": "skip"}
    figure = go.Figure([{**shown, **wires(body.xyz), "line": {"color": "#c4ccd4", "width": 2}, "name": "at rest"}])
    buttons = []
    elastic = list(range(modes.rigid_count, body.shapes.shape[2]))
    for nth, k in enumerate(elastic):
        shape = body.shapes[:, :, k]
        largest = float(np.linalg.norm(shape, axis=1).max(initial=0.0))
        moved = body.xyz + (_SWING * size / largest if largest else 0.0) * shape
        look, label = {"color": "#D55E00", "width": 3}, f"mode {k + 1}: {modes.frequencies_hz[k]:.4g} Hz"
        figure.add_trace({**shown, **wires(moved), "line": look, "name": label, "visible": nth == 0})
        visible = [True, *(other == k for other in elastic)]
        buttons.append({"label": label, "method": "update", "args": [{"visible": visible}]})
    figure.update_layout(
        title=f"Modes of {body.name}",
        height=520,
        scene={"aspectmode": "data"},
        updatemenus=[{"buttons": buttons, "x": 0, "xanchor": "left"}],
    )
    return figure


def _place(what: str, name: str, names: Any) -> int:
    if name not in names:
        raise SceneError(not_among(what, name, names))
    return list(names).index(name)


def _body(name: str | None, parts: Any) -> str:
    if name is not None and name not in parts:
        raise SceneError(not_among("reduced body", name, parts))
    if not parts:
        raise SceneError("the scene has no flexible body")
    return next(iter(parts)) if name is None else name
