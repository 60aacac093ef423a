"""Static pictures of a run: responses with their errors, errors in every configuration, and all pictures as files."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import RunResult
from cmsreduce.report.page import decibels
from cmsreduce.report.palette import FULL, LIMIT, model_style
from cmsreduce.report.pictures.figure import drawn, legend_above, line_of, literal, plain_axes
from cmsreduce.report.pictures.modes import effective_mass_picture, gain_picture, mac_picture, sigma_picture
from cmsreduce.report.pictures.open_loop import nichols_picture, nyquist_picture
from cmsreduce.report.pictures.scene import scene_picture, shapes_picture
from cmsreduce.report.wording import FIGURES, Figure, compared, file_name, worst

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FIGURE_NAMES", "figure_pictures", "response_picture", "run_pictures", "write_pictures"]

FIGURE_NAMES = ("bode", "nyquist", "nichols", "error-cost", "mac", "modes", "scene", "errors", "gains")
"""Single pictures for papers and slides, at the worst configuration and channel."""

_INCHES, _WITH_PHASE = (8.0, 5.2), (8.0, 6.4)
_HALF_TURN = 180.0
# Smaller than any error visible in the upper panel; keeps the logarithmic axis finite.
_FLOOR_DB = 1e-4


def response_picture(
    run: RunResult,
    path: Path,
    configuration: int = 0,
    channel: tuple[int, int] = (0, 0),
    *,
    phase: bool = False,
) -> None:
    """Draw the responses of the reference and of the reduced models, and their errors below.

    Parameters
    ----------
    run : RunResult
        With at least one configuration verified.
    path : Path
        File to write; its suffix says the format, such as ``.png`` (1200 x 780 pixels) or ``.svg``.
    configuration : int
        Number of the configuration, from 0.
    channel : (int, int)
        Numbers of output and input, from 0.
    phase : bool
        Draw the phase, too, in a panel between.

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
    with drawn(path, _WITH_PHASE if phase else _INCHES) as figure:
        if phase:
            above, between, below = figure.subplots(3, 1, sharex=True, height_ratios=(2.2, 1, 1))
            between.plot(hz, _degrees(result.response.full[:, o, i]), **line_of(FULL))
        else:
            above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
        above.plot(hz, full, label="full", **line_of(FULL))
        limit = run.limits.get("db_error")
        top, own = _FLOOR_DB if limit is None else max(limit, _FLOOR_DB), _FLOOR_DB
        for k, model in enumerate((run.model, *compared(run))):
            if model not in result.response.reduced:
                continue
            curve = decibels(result.response.reduced[model][:, o, i])
            error = np.maximum(abs(curve - full), _FLOOR_DB)
            # The run's own model lies on top of the others.
            look = line_of(model_style(k)) | {"zorder": 3 - 0.1 * k}
            above.plot(hz, curve, label=literal(model), **look)
            if phase:
                between.plot(hz, _degrees(result.response.reduced[model][:, o, i]), **look)
            below.plot(hz, error, **look)
            largest = float(np.max(error, initial=_FLOOR_DB, where=np.isfinite(error)))
            top, own = max(top, largest), largest if k == 0 else own
        if limit is not None:
            _draw_limit(below, limit, next(each for each in FIGURES if each.name == "db_error"))
        above.set(ylabel="magnitude, dB", xscale="log")
        title = literal(f"{run.inputs[i]} → {run.outputs[o]}, {result.configuration.name}")
        above.set_title(title, loc="left")
        below.set(xlabel="frequency, Hz", ylabel="|error|, dB", yscale="log")
        # Smaller errors than a thousandth of the run's largest are of no interest.
        below.set_ylim(0.7 * max(own / 1e3, _FLOOR_DB), 2 * top)
        positive = hz[hz > 0]
        if positive.size > 1:
            below.set_xlim(positive[0], positive[-1])
        plain_axes(above)
        if phase:
            between.set(ylabel="phase, deg", ylim=(-190, 190), yticks=(-180, -90, 0, 90, 180))
            plain_axes(between)
        plain_axes(below, x="log", y="log")
        legend_above(figure, above)
        figure.align_ylabels()


def _degrees(response: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Phase, without the line from one end of the turn to the other."""
    angle = np.degrees(np.angle(response))
    angle[1:][abs(np.diff(angle)) > _HALF_TURN] = np.nan
    return angle


def _draw_limit(axes: Axes, limit: float, figure: Figure) -> None:
    axes.axhline(figure.scale * limit, color=LIMIT, linewidth=0.8)
    at: Any = {"xycoords": ("axes fraction", "data"), "textcoords": "offset points"}
    axes.annotate(f"limit {figure.text(limit)}", (0, figure.scale * limit), (4, 3), color=LIMIT, **at)


def write_pictures(run: RunResult, folder: Path, suffix: str = ".png") -> list[Path]:
    """Draw a run: scene, modes, responses of every channel at the worst configuration, errors; return the files.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Made if it does not exist.
    suffix : {".png", ".svg"}
        Format.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = []
    for name, draw in run_pictures(run).items():
        made.append(folder / f"{file_name(name)}{suffix}")
        draw(made[-1])
    return made


def run_pictures(run: RunResult) -> dict[str, Callable[[Path], None]]:
    """Every picture of a run, by its name: functions that draw into a file."""
    found: dict[str, Callable[[Path], None]] = {}
    names = [result.configuration.name for result in run.configurations]
    rows = worst(run, run.model)
    at = names.index(rows[0][1].note) if rows else 0
    if run.drawing is not None:
        where = names[at] if names else next(iter(run.drawing.systems))
        found["scene"] = partial(scene_picture, run.drawing, where)
        if run.drawing.systems[where].hz.size:
            found["shapes"] = partial(shapes_picture, run.drawing, where)
    if run.configurations:
        found["errors"] = partial(error_picture, run)
        for o, output in enumerate(run.outputs):
            for i, given in enumerate(run.inputs):
                found[f"response_{given}_{output}"] = partial(response_picture, run, configuration=at, channel=(o, i))
        errors = run.configurations[at].errors.get(run.model)
        if errors is not None and errors.mac_matrix is not None and errors.mac_matrix.mac.size:
            found["mac"] = partial(mac_picture, errors.mac_matrix, names[at])
    for name, part in run.components.items():
        if np.isfinite(part.modes.sigma).any():
            found[f"sigma_{name}"] = partial(sigma_picture, part)
        if name in run.effective_mass:
            found[f"effective_mass_{name}"] = partial(effective_mass_picture, name, run.effective_mass[name])
    if run.gains:
        found["gains"] = partial(gain_picture, run, names[at] if names else next(iter(run.gains)))
    return found


def figure_pictures(run: RunResult) -> dict[str, Callable[[Path], None]]:
    """Pictures of `FIGURE_NAMES` that a run has data for: functions that draw into a file.

    Parameters
    ----------
    run : RunResult
        ``bode`` is the worst channel at its worst configuration, with phase; ``nyquist`` and ``nichols`` are the
        controller's open loop where it has the least margin, or the same channel.
    """
    every = run_pictures(run)
    found = {"modes": every["shapes"]} if "shapes" in every else {}
    found |= {name: every[name] for name in ("mac", "scene", "errors", "gains") if name in every}
    if run.configurations:
        at, channel = _worst_response(run)
        found["bode"] = partial(response_picture, run, configuration=at, channel=channel, phase=True)
        for name, draw in (("nyquist", nyquist_picture), ("nichols", nichols_picture)):
            found[name] = partial(draw, run, configuration=at, channel=channel)
        found["error-cost"] = partial(error_cost_picture, run)
    return {name: found[name] for name in FIGURE_NAMES if name in found}


def _worst_response(run: RunResult) -> tuple[int, tuple[int, int]]:
    """Configuration and channel with the largest error of the run's own model."""
    found = [(k, each) for k, result in enumerate(run.configurations) if (each := result.errors.get(run.model))]
    if not found:
        return 0, (0, 0)
    at, errors = max(found, key=lambda one: (one[1].channel_error or 0.0, one[1].frf_error))
    return at, errors.worst_channel or (0, 0)


def error_cost_picture(run: RunResult, path: Path) -> None:
    """Draw the worst response error of every model against its size."""
    figure_of, points = FIGURES[0], list[tuple[int, str, int, float]]()
    for k, model in enumerate((run.model, *compared(run))):
        found = [result.errors[model] for result in run.configurations if model in result.errors]
        error = max((each.frf_error for each in found), default=np.inf)
        if 0 < error < np.inf:
            points.append((k, model, max(each.coordinates or 0 for each in found), figure_of.scale * error))
    middle = np.mean([min(p[2] for p in points), max(p[2] for p in points)]) if points else 0.0
    with drawn(path) as figure:
        axes = figure.subplots()
        for k, model, size, error in points:
            colour, right = model_style(k).colour, size <= middle
            axes.plot(size, error, marker="osD^vP"[k % 6], color=colour, markersize=9 if k == 0 else 6, linestyle="")
            place: Any = {"textcoords": "offset points", "ha": "left" if right else "right"}
            axes.annotate(literal(model), (size, error), (7 if right else -7, 5), color=colour, **place)
        if (limit := run.limits.get(figure_of.name)) is not None:
            _draw_limit(axes, limit, figure_of)
        axes.set(yscale="log", xlabel="coordinates of the system", ylabel=f"{figure_of.label}, {figure_of.unit}")
        axes.margins(x=0.1, y=0.12)
        plain_axes(axes, y="log")


def error_picture(run: RunResult, path: Path) -> None:
    """Draw the response error of every model in every configuration."""
    figure_of = FIGURES[0]
    names = [result.configuration.name for result in run.configurations]
    with drawn(path) as figure:
        axes = figure.subplots()
        for k, model in enumerate((run.model, *compared(run))):
            look = model_style(k)
            found = [
                (c, result.errors[model].frf_error)
                for c, result in enumerate(run.configurations)
                if model in result.errors
            ]
            shown = [(c, figure_of.scale * value) for c, value in found if np.isfinite(value) and value > 0]
            if shown:
                x, y = zip(*shown, strict=True)
                axes.plot(x, y, marker="osD^vP"[k % 6], markersize=5, label=literal(model), **line_of(look))
        limit = run.limits.get(figure_of.name)
        if limit is not None:
            _draw_limit(axes, limit, figure_of)
        axes.set_yscale("log")
        axes.set_ylabel(f"{figure_of.label}, {figure_of.unit}")
        axes.set_xticks(
            range(len(names)),
            [literal(name) for name in names],
            rotation=30 if len(names) > 4 else 0,
            ha="right" if len(names) > 4 else "center",
        )
        legend_above(figure, axes)
        plain_axes(axes, y="log")
