"""The response overlay as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.model import RunResult
from cmsreduce.report.curves import decibels
from cmsreduce.report.figure import drawn, legend_above, line_of, literal, plain_axes
from cmsreduce.report.palette import FULL, LIMIT, model_style
from cmsreduce.report.wording import FIGURES, compared

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["response_picture"]

_INCHES = (8.0, 5.2)
# Below the smallest error an eye finds on the upper panel; keeps the logarithmic axis finite.
_FLOOR_DB = 1e-4


def response_picture(run: RunResult, path: Path, configuration: int = 0, channel: tuple[int, int] = (0, 0)) -> None:
    """Draw the responses of the full and the reduced models, and their errors below.

    Parameters
    ----------
    run : RunResult
        With at least one configuration verified.
    path : Path
        File to write; its suffix says the format, such as ``.png`` (1200 x 780 pixels) or ``.svg``.
    configuration : int
        Which configuration.
    channel : (int, int)
        Output and input.

    Raises
    ------
    WriteError
        If the run has no such response.
    """
    o, i = channel
    counts = (len(run.configurations), len(run.outputs), len(run.inputs))
    if not all(0 <= at < count for at, count in zip((configuration, o, i), counts, strict=True)):
        raise WriteError(
            f"{path}: there is no response of configuration {configuration}, output {o}, input {i} to draw; the run "
            f"verified {counts[0]} configurations of {counts[1]} outputs and {counts[2]} inputs (counted from 0)"
        )
    result = run.configurations[configuration]
    hz, full = result.response.frequency_hz, decibels(result.response.full[:, o, i])
    with drawn(path, _INCHES) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        above.plot(hz, full, label="full", **line_of(FULL))
        limit = run.limits.get("db_error")
        top, own = _FLOOR_DB if limit is None else max(limit, _FLOOR_DB), _FLOOR_DB
        for k, model in enumerate((run.model, *compared(run))):
            if model not in result.response.reduced:
                continue
            curve = decibels(result.response.reduced[model][:, o, i])
            error = np.maximum(abs(curve - full), _FLOOR_DB)
            # The run's own model lies on top of those it is compared with.
            look = line_of(model_style(k)) | {"zorder": 3 - 0.1 * k}
            above.plot(hz, curve, label=literal(model), **look)
            below.plot(hz, error, **look)
            largest = float(np.max(error, initial=_FLOOR_DB, where=np.isfinite(error)))
            top, own = max(top, largest), largest if k == 0 else own
        if limit is not None:
            _draw_limit(below, limit)
        above.set(ylabel="magnitude, dB", xscale="log")
        title = literal(f"{run.inputs[i]} → {run.outputs[o]}, {result.configuration.name}")
        above.set_title(title, loc="left")
        below.set(xlabel="frequency, Hz", ylabel="|error|, dB", yscale="log")
        # Three decades below the run's own worst: the rest of the error is nothing anybody looks for.
        below.set_ylim(0.7 * max(own / 1e3, _FLOOR_DB), 2 * top)
        positive = hz[hz > 0]
        if positive.size > 1:
            below.set_xlim(positive[0], positive[-1])
        plain_axes(above)
        plain_axes(below, x="log", y="log")
        legend_above(figure, above)
        figure.align_ylabels()


def _draw_limit(axes: Axes, limit: float) -> None:
    axes.axhline(limit, color=LIMIT, linewidth=0.8)
    at: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    axes.annotate(f"limit {FIGURES[1].text(limit)}", (0, limit), (4, 3), color=LIMIT, **at)
