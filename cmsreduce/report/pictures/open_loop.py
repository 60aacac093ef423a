"""Nyquist and Nichols pictures: the open loop of the scene's controller, or the worst channel without one."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import RunResult
from cmsreduce.report.page import decibels
from cmsreduce.report.palette import FULL, LIMIT, LineStyle, model_style
from cmsreduce.report.pictures.figure import drawn, legend_above, line_of, literal, plain_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["nichols_picture", "nyquist_picture"]

# A resonance is a circle far larger than the part near -1 that tells of stability.
_WINDOW = 6.0
_GAIN_DB, _HALF_TURN = 60.0, 180.0


class _Loop(NamedTuple):
    """Open loop of the reference and of the run's own model (f,), and what it is."""

    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    title: str
    closed: bool


def nyquist_picture(run: RunResult, path: Path, configuration: int, channel: tuple[int, int]) -> None:
    """Draw the open loop in the complex plane, with the point -1 if a controller closes it.

    Parameters
    ----------
    run : RunResult
        With verified configurations.
    path : Path
        File to write.
    configuration : int
        Number of the configuration, for a run without a controller; with one, the one with the least margin is drawn.
    channel : (int, int)
        Output and input that are drawn without a controller.

    Notes
    -----
    Of several loops det(I + G K) - 1 is drawn: it turns about -1 as the closed loop has unstable roots (MacFarlane and
    Postlethwaite 1977), and is G K for a single one.
    """
    loop = _loop(run, configuration, channel)
    with drawn(path, (6.4, 6.0)) as figure:
        axes = figure.subplots()
        for values, style, label in _curves(run, loop):
            axes.plot(values.real, values.imag, label=label, **line_of(style))
        axes.set(xlabel="real part", ylabel="imaginary part", title=literal(loop.title))
        if loop.closed:
            _critical(axes, -1.0, 0.0)
            reach = min(_WINDOW, 1.1 * max(2.0, float(abs(loop.full).max(initial=0.0))))
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach))
        axes.set_aspect("equal")
        plain_axes(axes)
        legend_above(figure, axes)


def nichols_picture(run: RunResult, path: Path, configuration: int, channel: tuple[int, int]) -> None:
    """Draw the gain of the open loop in dB over its phase; arguments as `nyquist_picture`."""
    loop = _loop(run, configuration, channel)
    with drawn(path, (6.8, 5.6)) as figure:
        axes = figure.subplots()
        # Loops of one turn lie between -360 and 0 degrees, so that -1 is at -180, and both models in one turn.
        first = np.degrees(np.angle(loop.full[:1])) - 2 * _HALF_TURN * (np.angle(loop.full[:1]) > 0)
        for values, style, label in _curves(run, loop):
            phase = np.degrees(np.unwrap(np.angle(values)))
            turns = np.round((phase[:1] - first) / (2 * _HALF_TURN))
            axes.plot(phase - 2 * _HALF_TURN * turns, decibels(values), label=label, **line_of(style))
        axes.set(xlabel="phase, deg", ylabel="gain, dB", title=literal(loop.title))
        if loop.closed:
            _critical(axes, -_HALF_TURN, 0.0)
            top = float(decibels(loop.full).max(initial=0.0))
            axes.set_ylim(max(-_GAIN_DB, float(np.nanmin(decibels(loop.full), initial=0.0))), max(top + 5, 10.0))
        plain_axes(axes)
        legend_above(figure, axes)


def _loop(run: RunResult, configuration: int, channel: tuple[int, int]) -> _Loop:
    known = [margin for margin in run.margins if margin.loops is not None]
    if known:
        margin = max(known, key=lambda each: each.ratio)
        assert margin.loops is not None
        return _Loop(*margin.loops, f"open loop of the controller, {margin.configuration}", True)
    o, i = channel
    result = run.configurations[configuration]
    full, reduced = result.response.full[:, o, i], result.response.reduced[run.model][:, o, i]
    return _Loop(full, reduced, f"{run.inputs[i]} → {run.outputs[o]}, {result.configuration.name}", False)


def _curves(run: RunResult, loop: _Loop) -> Iterator[tuple[NDArray[np.complex128], LineStyle, str]]:
    yield loop.full, FULL, "full"
    yield loop.reduced, model_style(0), literal(run.model)


def _critical(axes: Axes, x: float, y: float) -> None:
    axes.plot([x], [y], marker="+", markersize=12, color=LIMIT, linestyle="", label="-1")
