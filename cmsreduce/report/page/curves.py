"""Data of the plots of responses and errors: plain JSON values, and the places of their arrays."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import DOF_NAMES, ConfigurationResult, DampedPairs, ModelErrors, RunResult, SimulationCost
from cmsreduce.report.page.packing import ArrayStore, thinned_points
from cmsreduce.report.palette import FULL, INK, LIMIT, model_style
from cmsreduce.report.wording import Figure, compared, measured

__all__ = ["all_rounded", "decibels", "phase_degrees", "response_data", "rounded"]

# Digits of numbers in the page's JSON, more than a plot or a tooltip shows.
_DIGITS = 5
# Largest number of columns of a curve, as on a wide screen, and the smallest that still draws a resonance. Many curves
# have fewer columns, so that the page opens quickly.
_COLUMNS, _FEWEST = 700, 60
# Bytes of all curves before compression.
_BUDGET = 8e6
# Curves of all configurations: those of 60 columns take the budget. Of more, the channels with the largest errors are
# drawn, and at least so many of them.
_CURVES, _CHANNELS = 2000, 20


def decibels(H: ArrayLike) -> NDArray[np.float64]:
    """Magnitude in dB re 1, NaN where the response is zero or not finite."""
    size = np.abs(np.asarray(H))
    known = np.isfinite(size) & (size > 0)
    return np.where(known, 20 * np.log10(np.where(known, size, 1.0)), np.nan)


def phase_degrees(H: ArrayLike) -> NDArray[np.float64]:
    """Phase in degrees, above -180 and up to 180; NaN where the response is zero or not finite."""
    values = np.asarray(H)
    known = np.isfinite(values) & (values != 0)
    return np.where(known, np.degrees(np.angle(np.where(known, values, 1.0))), np.nan)


def response_data(run: RunResult, store: ArrayStore) -> dict[str, Any]:
    """Curves and errors of a run.

    Parameters
    ----------
    run : RunResult
    store : ArrayStore
        Takes the curves.

    Returns
    -------
    dict
        ``models`` gives the order of all lists by model, the run's own first; ``first`` is the configuration and the
        channel with the largest error. Curves are thinned, and of many channels those ``drawn`` alone have them;
        frequencies in Hz, magnitudes in dB re 1, phases in degrees. ``apart`` is the magnitude of a reduced model less
        the magnitude of the reference (or 0 without a response), ``turned`` its phase less that of the reference.
    """
    models = (run.model, *compared(run))
    figures = measured(run)
    channels = [(o, i) for o in range(len(run.outputs)) for i in range(len(run.inputs))]
    at, worst = run.worst_response
    first = worst[0] * len(run.inputs) + worst[1]
    drawn = _drawn(run, first)
    most = _BUDGET / max(1, len(run.configurations) * len(drawn)) / (6 + 4 * len(models))
    return {
        "models": list(models),
        "styles": {
            "full": asdict(FULL),
            "models": [asdict(model_style(k)) for k in range(len(models))],
            "limit": LIMIT,
            "ink": INK,
        },
        "band": list(run.band),
        "first": [at, first],
        "drawn": sorted(drawn),
        "configurations": [result.configuration.name for result in run.configurations],
        "axes": _axes(run),
        "channels": [
            {
                "label": f"{run.inputs[i]} → {run.outputs[o]}",
                "input": run.inputs[i],
                "output": run.outputs[o],
                "unit": run.response_unit(o, i),
            }
            for o, i in channels
        ],
        "figures": [_figure(run, figure, models) for figure in figures],
        "speed": _speed(run, models),
        "settings": [_setting(result, models, channels, drawn, figures, store, most) for result in run.configurations],
    }


def _drawn(run: RunResult, first: int) -> set[int]:
    """Numbers of the channels with curves: those with the largest response and decibel errors, the worst one first."""
    count = len(run.outputs) * len(run.inputs)
    most = max(_CHANNELS, _CURVES // max(1, len(run.configurations)))
    if count <= most:
        return set(range(count))
    size = np.zeros(count)
    errors = [result.errors[run.model] for result in run.configurations if run.model in result.errors]
    for name in ("channel_errors", "channel_db"):
        found = [np.nan_to_num(values.ravel()) for each in errors if (values := getattr(each, name)) is not None]
        worst = np.max([np.zeros(count), *found], axis=0)
        size = np.maximum(size, worst / (worst.max(initial=0.0) or 1.0))
    size[first] = np.inf
    return set(np.argsort(-size, kind="stable")[:most].tolist())


def _figure(run: RunResult, figure: Figure, models: Iterable[str]) -> dict[str, Any]:
    limit = run.limits.get(figure.name)
    return {
        "name": figure.name,
        "label": figure.label,
        "unit": figure.unit,
        "limit": None if limit is None else rounded(figure.scale * limit),
        "values": [
            [
                rounded(figure.scale * getattr(result.errors[model], figure.name)) if model in result.errors else None
                for result in run.configurations
            ]
            for model in models
        ],
    }


def _axes(run: RunResult) -> list[dict[str, Any]]:
    """Articulated motions and parameters with more than one value, and their value in each configuration."""
    settings = [result.configuration.angles for result in run.configurations]
    found = []
    for joint, dof in dict.fromkeys(axis for angles in settings for axis in angles):
        turn = dof >= len(DOF_NAMES) // 2
        values = [angles.get((joint, dof), 0.0) for angles in settings]
        if len(set(values)) > 1:
            scale = 180 / math.pi if turn else 1.0
            label = f"{joint}.{DOF_NAMES[dof]}"
            found.append(
                {"label": label, "unit": "deg" if turn else "", "values": all_rounded(np.array(values) * scale)}
            )
    varied = [result.configuration.parameters for result in run.configurations]
    for name in dict.fromkeys(name for parameters in varied for name in parameters):
        values = [parameters.get(name, 0.0) for parameters in varied]
        if len(set(values)) > 1:
            found.append({"label": name, "unit": "", "values": all_rounded(np.array(values))})
    return found


def _speed(run: RunResult, models: Iterable[str]) -> dict[str, Any] | None:
    """Costs of each model in all configurations, the reference model first; those of a simulation at their worst."""
    if not run.configurations:
        return None
    first, costs = run.configurations[0], None if run.speed is None else run.speed.simulation
    full = {"coordinates": first.n_full, "seconds": None if run.speed is None else rounded(run.speed.full_frf_s)}
    rows = [full | _simulation(None if costs is None else costs.full)]
    for model in models:
        found = [result.errors[model] for result in run.configurations if model in result.errors]
        spent = [each.seconds for each in found if each.seconds is not None]
        size = found[0].coordinates if found else None
        own = first.n_reduced if model == run.model else None
        whole = rounded(sum(spent)) if spent and len(spent) == len(found) else None
        if whole is None and model == run.model and run.speed is not None:
            whole = rounded(run.speed.reduced_frf_s)
        cost = costs.reduced if costs is not None and model == run.model else None
        rows.append({"coordinates": own if size is None else size, "seconds": whole} | _simulation(cost))
    return {"full": rows[0], "models": rows[1:]}


def _simulation(cost: SimulationCost | None) -> dict[str, float | None]:
    """Steps, operations and seconds of a simulated second; None where they are not known."""
    if cost is None:
        return {"steps": None, "operations": None, "simulation": None}
    seconds = rounded(cost.seconds) if math.isfinite(cost.seconds) else None
    return {"steps": rounded(cost.steps_per_second), "operations": rounded(cost.operations), "simulation": seconds}


def _setting(
    result: ConfigurationResult,
    models: Iterable[str],
    channels: list[tuple[int, int]],
    drawn: set[int],
    figures: tuple[Figure, ...],
    store: ArrayStore,
    most: float,
) -> dict[str, Any]:
    errors = [result.errors.get(model) for model in models]
    return {
        "full": [result.n_full, result.modes_full],
        "reduced": [result.n_reduced, result.modes_reduced],
        "errors": [found and [figure.text(getattr(found, figure.name)) for figure in figures] for found in errors],
        "frac": [found and [rounded(found.frac[channel]) for channel in channels] for found in errors],
        "pairs": _pairs(errors[0]) if errors[0] else [],
        "damped": _damped_pairs(errors[0].damped) if errors[0] and errors[0].damped else None,
        "mac": _mac(errors[0], store) if errors[0] else None,
        "hz": store.exact(result.response.frequency_hz, "f4") if channels else None,
        "curves": list(_curves(result, models, channels, drawn, store, most)),
    }


def _curves(
    result: ConfigurationResult,
    models: Iterable[str],
    channels: list[tuple[int, int]],
    drawn: set[int],
    store: ArrayStore,
    most: float,
) -> Iterator[dict[str, Any] | None]:
    # The channels of one configuration need similar numbers of columns.
    columns = float(_COLUMNS)
    for number, (o, i) in enumerate(channels):
        if number not in drawn:
            yield None
            continue
        found, used = _channel(result, models, o, i, store, most, min(_COLUMNS, 1.2 * columns))
        columns = used
        yield found


def _mac(found: ModelErrors, store: ArrayStore) -> dict[str, Any] | None:
    table = found.mac_matrix
    if table is None or not table.mac.size:
        return None
    mac = np.clip(np.rint(255 * table.mac), 0, 255)
    return {"full": all_rounded(table.full_hz), "reduced": all_rounded(table.reduced_hz), "mac": store.exact(mac, "u1")}


def _pairs(found: ModelErrors) -> list[list[float | None]]:
    """Full and reduced frequency in Hz, shift in per cent and MAC of every pair."""
    full, reduced = found.full_hz, found.reduced_hz
    shift = 100 * (reduced - full) / np.where(full > 0, full, np.nan)
    return [all_rounded(pair) for pair in zip(full, reduced, shift, found.mac, strict=True)]


def _damped_pairs(found: DampedPairs) -> list[list[float | None]]:
    """Full and reduced frequency in Hz, damping ratios in per cent and MAC of every complex pair."""
    columns = (found.full_hz, found.reduced_hz, 100 * found.full_zeta, 100 * found.reduced_zeta, found.mac)
    return [all_rounded(pair) for pair in zip(*columns, strict=True)]


def _channel(
    result: ConfigurationResult, models: Iterable[str], o: int, i: int, store: ArrayStore, most: float, columns: float
) -> tuple[dict[str, Any], float]:
    response, H = result.response, result.response.full[:, o, i]
    full, phase = decibels(H), phase_degrees(H)
    own = {m: response.reduced[m][:, o, i] for m in models if m in response.reduced}
    reduced = {m: decibels(each) for m, each in own.items()}
    missed = {m: decibels(_missed(H, each)) for m, each in own.items()}
    errors = [abs(curve - full) for curve in reduced.values()]
    curves = np.vstack([full, *reduced.values(), *errors, *missed.values()])
    at = thinned_points(response.frequency_hz, curves, int(columns))
    while at.size > most and columns > _FEWEST:
        columns = max(_FEWEST, columns * min(0.9, most / at.size))
        at = thinned_points(response.frequency_hz, curves, int(columns))
    base = np.where(np.isnan(full), 0.0, full)
    found = {
        "at": store.ascending(at),
        "full": store.rounded(full[at]),
        # A difference, so that rounding of both curves does not hide the error of a good model.
        "apart": [store.rounded(reduced[m][at] - base[at]) if m in reduced else None for m in models],
        "phase": store.rounded(phase[at]),
        "turned": [store.rounded(phase_degrees(own[m] * H.conj())[at]) if m in own else None for m in models],
    }
    return found, columns


def _missed(full: NDArray[np.complex128], reduced: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Relative error of a reduced response, in magnitude and phase; NaN where the reference response is zero."""
    known = full != 0
    error = abs(reduced - full) / np.where(known, abs(full), 1.0)
    # Zero has no place on a logarithmic axis.
    return np.where(known, np.maximum(error, np.finfo(float).eps), np.nan)


def all_rounded(values: Iterable[float]) -> list[float | None]:
    """Numbers for JSON, to the digits that are shown; null for numbers that are not finite."""
    return [rounded(value) for value in values]


def rounded(value: float) -> float | None:
    """Number to the digits that are shown; None if it is not finite."""
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
