"""What the plots of the page are drawn from, as plain JSON values."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import ComponentResult, ConfigurationResult, DampedPairs, ModelErrors, RunResult
from cmsreduce.report.palette import FULL, INK, LIMIT, model_style
from cmsreduce.report.thinning import thinned_points
from cmsreduce.report.wording import Figure, compared, measured

__all__ = ["decibels", "plot_data"]

# More digits than a plot or a tooltip shows.
_DIGITS = 5


def decibels(H: ArrayLike) -> NDArray[np.float64]:
    """Magnitude in dB re 1, NaN where the response is zero or not finite."""
    size = np.abs(np.asarray(H))
    known = np.isfinite(size) & (size > 0)
    return np.where(known, 20 * np.log10(np.where(known, size, 1.0)), np.nan)


def plot_data(run: RunResult) -> dict[str, Any]:
    """Curves, errors and modes of a run.

    Parameters
    ----------
    run : RunResult

    Returns
    -------
    dict
        ``models`` label in one order what stands in every list beside them, the run's own first. Curves are thinned
        and packed as base64 of little-endian float32; frequencies in Hz, magnitudes in dB re 1, ``missed`` the
        magnitude of the difference in dB re the full response.
    """
    models = (run.model, *compared(run))
    figures = measured(run)
    channels = [(o, i) for o in range(len(run.outputs)) for i in range(len(run.inputs))]
    return {
        "models": list(models),
        "styles": {
            "full": asdict(FULL),
            "models": [asdict(model_style(k)) for k in range(len(models))],
            "limit": LIMIT,
            "ink": INK,
        },
        "band": list(run.band),
        "configurations": [result.configuration.name for result in run.configurations],
        "channels": [
            {"label": f"{run.inputs[i]} → {run.outputs[o]}", "input": run.inputs[i], "output": run.outputs[o]}
            for o, i in channels
        ],
        "figures": [
            {
                "label": figure.label,
                "unit": figure.unit,
                "limit": _rounded(figure.scale * run.limits[figure.name]) if figure.name in run.limits else None,
                "values": [
                    [
                        _rounded(figure.scale * getattr(result.errors[model], figure.name))
                        if model in result.errors
                        else None
                        for result in run.configurations
                    ]
                    for model in models
                ],
            }
            for figure in figures
        ],
        "settings": [_setting(result, models, channels, figures) for result in run.configurations],
        "components": [_modes(part) for part in run.components.values()],
    }


def _setting(
    result: ConfigurationResult, models: Iterable[str], channels: list[tuple[int, int]], figures: tuple[Figure, ...]
) -> dict[str, Any]:
    errors = [result.errors.get(model) for model in models]
    return {
        "full": [result.n_full, result.modes_full],
        "reduced": [result.n_reduced, result.modes_reduced],
        "errors": [found and [figure.text(getattr(found, figure.name)) for figure in figures] for found in errors],
        "frac": [found and [_rounded(found.frac[channel]) for channel in channels] for found in errors],
        "pairs": _pairs(errors[0]) if errors[0] else [],
        "damped": _damped_pairs(errors[0].damped) if errors[0] and errors[0].damped else None,
        "curves": [_channel(result, models, o, i) for o, i in channels],
    }


def _pairs(found: ModelErrors) -> list[list[float | None]]:
    """Full and reduced frequency in Hz, shift in per cent and likeness of shapes of every pair."""
    full, reduced = found.full_hz, found.reduced_hz
    shift = 100 * (reduced - full) / np.where(full > 0, full, np.nan)
    return [_all_rounded(pair) for pair in zip(full, reduced, shift, found.mac, strict=True)]


def _damped_pairs(found: DampedPairs) -> list[list[float | None]]:
    """Full and reduced frequency in Hz and damping ratio in per cent, and likeness of shapes, of every complex pair."""
    columns = (found.full_hz, found.reduced_hz, 100 * found.full_zeta, 100 * found.reduced_zeta, found.mac)
    return [_all_rounded(pair) for pair in zip(*columns, strict=True)]


def _channel(result: ConfigurationResult, models: Iterable[str], o: int, i: int) -> dict[str, Any]:
    response = result.response
    full = decibels(response.full[:, o, i])
    reduced = {m: decibels(response.reduced[m][:, o, i]) for m in models if m in response.reduced}
    missed = {m: decibels(_missed(response.full[:, o, i], response.reduced[m][:, o, i])) for m in reduced}
    errors = [abs(curve - full) for curve in reduced.values()]
    at = thinned_points(response.frequency_hz, np.vstack([full, *reduced.values(), *errors, *missed.values()]))
    return {
        "hz": _packed(response.frequency_hz[at]),
        "full": _packed(full[at]),
        "reduced": [_packed(reduced[m][at]) if m in reduced else None for m in models],
        "missed": [_packed(missed[m][at]) if m in missed else None for m in models],
    }


def _missed(full: NDArray[np.complex128], reduced: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Share of the full response that the reduced one is off, in magnitude or phase; NaN where there is none."""
    heard = full != 0
    off = abs(reduced - full) / np.where(heard, abs(full), 1.0)
    # Two equal numbers differ by less than rounding, which unlike zero has a place on a logarithmic axis.
    return np.where(heard, np.maximum(off, np.finfo(float).eps), np.nan)


def _modes(part: ComponentResult) -> dict[str, Any]:
    modes = part.modes
    elastic = modes.elastic
    return {
        "name": part.name,
        "number": list(range(elastic.start + 1, elastic.stop + 1)),
        "hz": _all_rounded(modes.omega[elastic] / (2 * np.pi)),
        "sigma": [value if value else None for value in _all_rounded(modes.sigma[elastic])],
        "kind": list(modes.kind[elastic]),
        "kept": np.isin(np.arange(elastic.start, elastic.stop), part.kept).tolist(),
    }


def _packed(values: NDArray[np.float64]) -> str:
    return base64.b64encode(values.astype("<f4").tobytes()).decode("ascii")


def _all_rounded(values: Iterable[float]) -> list[float | None]:
    return [_rounded(value) for value in values]


def _rounded(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
