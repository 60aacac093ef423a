"""Data of the plots of reduction checks: static loads, zeros, step responses, the controller."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import ChannelZeros, ControllerMargin, GainSum, RunResult, StepErrors
from cmsreduce.report.page.curves import all_rounded, rounded
from cmsreduce.report.page.packing import ArrayStore, thinned_points

__all__ = ["check_data", "high_gains"]

# Bytes of all step responses before compression, and the fewest instants that still draw one.
_BUDGET, _FEWEST = 3e6, 120
# Part of |s| from which a root has left an axis: rounding moves a double root by the square root of its own.
_OFF_AXIS = 1e-6
# Smallest value on a logarithmic axis.
_LEAST = 1e-16
# Place of a zero in the plane of s.
_IMAGINARY, _REAL, _COMPLEX = 0, 1, 2


def check_data(run: RunResult, store: ArrayStore) -> dict[str, Any]:
    """Data of the checks of a reduction.

    Parameters
    ----------
    run : RunResult
    store : ArrayStore
        Takes zeros and curves.

    Returns
    -------
    dict
        ``statics``: body, load and energy error in per cent; ``zeros``, ``steps``, ``margins``: by configuration, with
        channels in the order of ``channels``, outputs outermost.
    """
    systems = () if run.checks is None else run.checks.systems
    stepped = [(each.configuration, each.step) for each in systems if each.step is not None]
    pairs = max(1, len(run.outputs) * len(run.inputs) * len(stepped))
    most = max(_FEWEST, int(_BUDGET / (4 * pairs)))
    return {
        "statics": _statics(run),
        "static_limit": _percent(run.limits.get("static_lack")),
        "zeros": [
            {"configuration": each.configuration, **_zeros(each.zeros, len(run.outputs), len(run.inputs), store)}
            for each in systems
            if each.zeros is not None
        ],
        "zero_first": _first([_worst_zeros(each.zeros, run) for each in systems if each.zeros is not None]),
        "zero_limit": _percent(run.limits.get("zero_error")),
        "steps": [{"configuration": name, **_step(step, store, most)} for name, step in stepped],
        "step_first": _first([step.rms.ravel() for _, step in stepped]),
        "margins": [_margin(each, store) for each in run.margins],
        "margin_first": _first([[each.ratio] for each in run.margins])[0],
    }


def high_gains(gains: GainSum, band_hz: float, store: ArrayStore) -> dict[str, Any]:
    """Modes above the band that are a large part of the gains of a pair, among those of the running sum.

    Parameters
    ----------
    gains : GainSum
        Gains of all modes of the mode sets.
    band_hz : float
        Upper end of the band.
    store : ArrayStore
        Takes position of the mode, channel, and share of the gains.
    """
    found = list(gains.high_gain_modes(band_hz))
    inputs = gains.static.shape[1]
    return {
        "mode": store.exact([each.mode for each in found], "u4"),
        "channel": store.exact([each.output * inputs + each.input for each in found], "u4"),
        "share": store.exact([each.share for each in found], "f4"),
    }


def _statics(run: RunResult) -> list[list[Any]]:
    static = {} if run.checks is None else run.checks.static
    return [[body, load, rounded(100 * lack)] for body, loads in static.items() for load, lack in loads.items()]


def _zeros(found: tuple[ChannelZeros, ...], outputs: int, inputs: int, store: ArrayStore) -> dict[str, Any]:
    """Zeros of all channels in one row, with the number of each channel."""
    by_channel = {pair.output * inputs + pair.input: pair for pair in found}
    rows: dict[str, list[NDArray[np.float64]]] = {"full": [], "reduced": [], "miss": []}
    places: dict[str, list[NDArray[np.int64]]] = {"full_place": [], "reduced_place": [], "judged": []}
    counts, worst = [], []
    for channel in range(outputs * inputs):
        pair = by_channel.get(channel)
        full, reduced, judged, miss = _drawn_pair(pair)
        for name, zeros in (("full", full), ("reduced", reduced)):
            rows[name].append(np.log10(abs(zeros) / (2 * np.pi)))
            places[f"{name}_place"].append(_place(zeros))
        places["judged"].append(judged)
        rows["miss"].append(np.log10(np.maximum(miss, _LEAST)))
        counts.append([full.size, reduced.size])
        worst.append(None if pair is None else [rounded(100 * pair.worst), pair.lost, int(pair.shift.size)])
    return {
        "counts": counts,
        "worst": worst,
        **{name: store.rounded(np.concatenate([np.empty(0), *values])) for name, values in rows.items()},
        **{
            name: store.exact(np.concatenate([np.empty(0, np.int64), *values]), "u1") for name, values in places.items()
        },
    }


def _drawn_pair(
    pair: ChannelZeros | None,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.int64], NDArray[np.float64]]:
    """Zeros of both models; for each reference zero, 1 if it is judged, and the distance from its partner.

    A zero that is not judged has no partner; its distance is that from the nearest zero.
    """
    if pair is None:
        return np.empty(0, complex), np.empty(0, complex), np.empty(0, np.int64), np.empty(0)
    judged, miss = np.zeros(pair.full.size, dtype=np.int64), _apart(pair.full, pair.reduced)
    if pair.judged is not None:
        judged[pair.judged], miss[pair.judged] = 1, pair.shift
    shown = _drawn(pair.full)
    return pair.full[shown], pair.reduced[_drawn(pair.reduced)], judged[shown], miss[shown]


def _drawn(zeros: NDArray[np.complex128]) -> NDArray[np.bool_]:
    """Mask of one zero of each pair mirrored in an axis, without those at the origin."""
    size = abs(zeros)
    return np.asarray((size > 0) & (zeros.real >= -_OFF_AXIS * size))


def _place(zeros: NDArray[np.complex128]) -> NDArray[np.int64]:
    size = abs(zeros)
    on_imaginary, on_real = abs(zeros.real) <= _OFF_AXIS * size, abs(zeros.imag) <= _OFF_AXIS * size
    return np.asarray(np.where(on_imaginary, _IMAGINARY, np.where(on_real, _REAL, _COMPLEX)), dtype=np.int64)


def _apart(full: NDArray[np.complex128], reduced: NDArray[np.complex128]) -> NDArray[np.float64]:
    """Distance of each zero from the nearest of the reduced system, relative; NaN without any."""
    if not reduced.size:
        return np.full(full.size, np.nan)
    size = np.where(full != 0, abs(full), 1.0)
    return np.asarray(abs(full[:, None] - reduced[None, :]).min(axis=1, initial=np.inf) / size)


def _step(step: StepErrors, store: ArrayStore, most: int) -> dict[str, Any]:
    every = max(1, math.ceil(step.time.size / most))
    full, apart = step.full[::every], (step.reduced - step.full)[::every]
    size = np.maximum(abs(step.full).max(axis=0, initial=0.0), abs(step.reduced).max(axis=0, initial=0.0))
    scale = np.where(size > 0, size, 1.0)
    return {
        "time": store.exact(step.time[::every], "f4"),
        "scale": store.exact(size, "f4"),
        "full": store.rounded(np.moveaxis(full / scale, 0, -1)),
        "apart": store.rounded(np.moveaxis(apart / scale, 0, -1)),
        "peak": all_rounded(100 * step.peak.ravel()),
        "rms": all_rounded(100 * step.rms.ravel()),
    }


def _margin(found: ControllerMargin, store: ArrayStore) -> dict[str, Any]:
    curves = np.log10(np.maximum(np.vstack([found.spillover, found.borne]), _LEAST))
    at = thinned_points(found.frequency_hz, np.vstack([curves, curves[0] - curves[1]]))
    return {
        "configuration": found.configuration,
        "hz": store.exact(found.frequency_hz[at], "f4"),
        "spillover": store.rounded(curves[0, at]),
        "borne": store.rounded(curves[1, at]),
        "ratio": rounded(found.ratio),
        "worst_hz": rounded(found.worst_hz),
        "unstable": found.unstable,
        "proven": found.proven,
    }


def _worst_zeros(found: tuple[ChannelZeros, ...], run: RunResult) -> NDArray[np.float64]:
    worst = np.zeros((len(run.outputs), len(run.inputs)))
    for pair in found:
        worst[pair.output, pair.input] = pair.worst
    return worst.ravel()


def _first(values: Sequence[ArrayLike]) -> tuple[int, int]:
    """Configuration and channel with the largest value, which the page shows first."""
    rows = [np.nan_to_num(np.asarray(each, dtype=np.float64)) for each in values]
    worst = max(range(len(rows)), key=lambda c: float(rows[c].max(initial=0.0)), default=0)
    return worst, int(rows[worst].argmax()) if rows and rows[worst].size else 0


def _percent(value: float | None) -> float | None:
    return None if value is None else rounded(100 * value)
