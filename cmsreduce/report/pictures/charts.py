"""Charts of a run: responses, errors, ranking and masses of modes, MAC."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import ComponentResult, EffectiveMassCurve, MacMatrix, RunResult
from cmsreduce.report.page import decibels, phase_degrees
from cmsreduce.report.palette import COLOURS, FULL, INK, LineStyle, model_style
from cmsreduce.report.pictures.chart import Chart, Panel, Series, Shades
from cmsreduce.report.wording import FIGURES, Figure, compared

__all__ = ["effective_mass", "error_against_cost", "errors_by_configuration", "mac", "ranking", "responses"]

_MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
_HALF_TURN = 180.0
# Smaller than any error visible in the upper panel; keeps the logarithmic axis finite.
_FLOOR_DB = 1e-4


def responses(run: RunResult, configuration: int, channel: tuple[int, int], *, phase: bool = True) -> Chart:
    """Responses of the reference and of the reduced models, with phase, and their errors below.

    Raises
    ------
    WriteError
        If the run has no such response.
    """
    o, i = channel
    counts = (len(run.configurations), len(run.outputs), len(run.inputs))
    if not all(0 <= at < count for at, count in zip((configuration, o, i), counts, strict=True)):
        raise WriteError(
            f"there is no response of configuration {configuration}, output {o}, input {i} to draw; the run "
            f"verified {counts[0]} configurations of {counts[1]} outputs and {counts[2]} inputs (counted from 0)"
        )
    result, unit = run.configurations[configuration], run.response_unit(o, i)
    hz, H = result.response.frequency_hz, result.response.full[:, o, i]
    last, limit = 2 if phase else 1, run.limits.get("db_error")
    top, own = _FLOOR_DB if limit is None else max(limit, _FLOOR_DB), _FLOOR_DB
    series: list[Series] = []

    def add(response: NDArray[np.complex128], name: str, look: LineStyle, ahead: float) -> None:
        size = abs(response)
        level = np.where(size > 0, size, np.nan) if unit else decibels(response)
        series.append(Series(hz, level, name, look, ahead=ahead))
        if phase:
            angle = phase_degrees(response)
            # No line from one end of the turn to the other.
            angle[1:][abs(np.diff(angle)) > _HALF_TURN] = np.nan
            series.append(Series(hz, angle, "", look, panel=1, ahead=ahead))

    add(H, "full", FULL, -1.0)
    for k, model in enumerate((run.model, *compared(run))):
        if model not in result.response.reduced:
            continue
        reduced = result.response.reduced[model][:, o, i]
        error = np.maximum(abs(decibels(reduced) - decibels(H)), _FLOOR_DB)
        # The run's own model lies on top of the others.
        add(reduced, model, model_style(k), 1 - 0.01 * k)
        series.append(
            Series(hz, np.asarray(error, dtype=np.float64), "", model_style(k), panel=last, ahead=1 - 0.01 * k)
        )
        largest = float(np.max(error, initial=_FLOOR_DB, where=np.isfinite(error)))
        top, own = max(top, largest), largest if k == 0 else own
    # Smaller errors than a thousandth of the run's largest are of no interest.
    below = Panel(
        "|error|, dB", True, (0.7 * max(own / 1e3, _FLOOR_DB), 2 * top), limit=_limit(run, _figure("db_error"))
    )
    above = Panel(f"magnitude, {unit}" if unit else "magnitude, dB", bool(unit), height=2.2)
    turn = Panel("phase, deg", range=(-190, 190), ticks=(-180, -90, 0, 90, 180))
    positive = hz[hz > 0]
    return Chart(
        f"{run.inputs[i]} → {run.outputs[o]}, {result.configuration.name}",
        "frequency, Hz",
        (above, turn, below) if phase else (above, below),
        tuple(series),
        x_log=True,
        x_range=(float(positive[0]), float(positive[-1])) if positive.size > 1 else None,
        inches=(8.0, 6.4) if phase else (8.0, 5.2),
    )


def error_against_cost(run: RunResult) -> Chart:
    """The worst response error of every model against its size."""
    figure, series = FIGURES[0], []
    for k, model in enumerate((run.model, *compared(run))):
        found = [result.errors[model] for result in run.configurations if model in result.errors]
        error = max((each.frf_error for each in found), default=np.inf)
        if 0 < error < np.inf:
            size = max(each.coordinates or 0 for each in found)
            at = np.array([float(size)]), np.array([figure.scale * error])
            # As on the page, the run's own model is a star.
            look = model_style(k) if k else replace(model_style(0), symbol="star")
            series.append(Series(*at, model if k else "this model", look, "named mark", ahead=-k))
    panel = Panel(f"{figure.label}, {figure.unit}", True, limit=_limit(run, figure))
    return Chart("", "coordinates of the system", (panel,), tuple(series), legend=0)


def errors_by_configuration(run: RunResult) -> Chart:
    """Response error of every model in every configuration."""
    figure, series = FIGURES[0], []
    for k, model in enumerate((run.model, *compared(run))):
        values = [each.errors[model].frf_error if model in each.errors else np.nan for each in run.configurations]
        y = np.asarray(figure.scale * np.array(values), dtype=np.float64)
        y[~(np.isfinite(y) & (y > 0))] = np.nan
        if np.isfinite(y).any():
            series.append(Series(np.arange(y.size, dtype=np.float64), y, model, model_style(k), "line and mark"))
    panel = Panel(f"{figure.label}, {figure.unit}", True, limit=_limit(run, figure))
    names = tuple(result.configuration.name for result in run.configurations)
    return Chart("", "", (panel,), tuple(series), x_names=names)


def ranking(part: ComponentResult) -> Chart:
    """Influence coefficients of a body's modes, kept ones filled, clusters joined by a line above."""
    modes = part.modes
    e = modes.elastic
    number, sigma = np.arange(e.start + 1, e.stop + 1, dtype=np.float64), modes.sigma[e]
    kept = np.isin(np.arange(e.start, e.stop), part.kept)
    blue = LineStyle(COLOURS[0], "solid", (), 1.0, "circle")
    ink = LineStyle(INK, "solid", (), 2.0, "circle")
    series = [Series(number[kept], sigma[kept], "kept", blue, "bar")]
    series.append(Series(number[~kept], sigma[~kept], "left out", blue, "open bar"))
    known = sigma[np.isfinite(sigma) & (sigma > 0)]
    if modes.cluster is not None and known.size:
        cluster = modes.cluster[e]
        for nth, group in enumerate(sorted(set(cluster[cluster > 0].tolist()))):
            at = number[cluster == group]
            height = np.full(at.size, known.max() * 10 ** (0.5 + 0.4 * (nth % 2)))
            series.append(Series(at, height, "" if nth else "clusters", ink, "line and mark", ahead=1))
    title = f"{part.name}: influence of its modes"
    return Chart(title, "mode, by frequency", (Panel("sigma", True),), tuple(series))


def effective_mass(name: str, curve: EffectiveMassCurve) -> Chart:
    """Running effective mass of a body's modes; circles at the modes kept."""
    dashes = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
    patterns = ((), (4, 2), (1, 1.6), (5, 2, 1, 2), (8, 3), (8, 3, 1, 3))
    series = []
    for k, motion in enumerate(_MOTIONS):
        look = LineStyle(COLOURS[k], dashes[k], patterns[k], 2.0, "circle")
        series.append(Series(curve.hz, 100 * curve.running[:, k], motion, look, "steps"))
        if curve.kept_hz.size:
            series.append(Series(curve.kept_hz[-1:], 100 * curve.kept_running[-1:, k], "", look, "circle"))
    panel = Panel("mass of the body, %", range=(0, 104))
    title = f"{name}: effective mass of its modes (circles: those kept)"
    return Chart(title, f"frequency, held at {curve.held}, Hz", (panel,), tuple(series), x_log=True, legend=6)


def mac(table: MacMatrix, where: str) -> Chart:
    """Modal assurance criterion between all modes of the reference and of the reduced system."""
    columns, rows = (tuple(f"{hz:.4g}" for hz in each) for each in (table.reduced_hz, table.full_hz))
    shades = Shades(np.asarray(table.mac, dtype=np.float64), columns, rows, "MAC")
    panel = Panel("modes of the full system, Hz")
    across = "modes of the reduced system, Hz"
    return Chart(f"MAC of the modes, {where}", across, (panel,), shades=shades, inches=(7.0, 5.6), legend=0)


def _figure(name: str) -> Figure:
    return next(each for each in FIGURES if each.name == name)


def _limit(run: RunResult, figure: Figure) -> tuple[float, str] | None:
    value = run.limits.get(figure.name)
    return None if value is None else (figure.scale * value, f"limit {figure.text(value)}")
