"""Data of the plots of modes: influence, effective mass, gains, completeness, projection, timings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ComponentResult, EffectiveMassCurve, GainSum, ProjectionRecord, RunResult
from cmsreduce.report.page.check_data import high_gains
from cmsreduce.report.page.curves import all_rounded, rounded
from cmsreduce.report.page.packing import ArrayStore

__all__ = ["mode_data"]

# Singular values below this share of the largest are rounding.
_ROUNDING = 1e-17
# Gains up to this size are zero.
_LEAST_GAIN = 1e-300


def mode_data(run: RunResult, store: ArrayStore, drawn: Sequence[int]) -> dict[str, Any]:
    """Modes of the bodies with their masses and gains, and times of the stages.

    Parameters
    ----------
    run : RunResult
    store : ArrayStore
        Takes the gains.
    drawn : sequence of int
        Channels whose running sums are drawn.
    """
    return {
        "components": [_modes(run, part) for part in run.components.values()],
        "effective_mass": [_effective(run.effective_mass.get(name)) for name in run.components],
        "gains": [_gain(name, *gains, run.band[1], store, drawn) for name, gains in run.gains.items()],
        "completeness": [[row.axis, row.configuration, rounded(100 * row.missing)] for row in run.completeness],
        "projection": None if run.projection is None else _projection(run.projection),
        "timings": _timings(run),
    }


def _modes(run: RunResult, part: ComponentResult) -> dict[str, Any]:
    modes = part.modes
    elastic = modes.elastic
    numbers = range(elastic.start + 1, elastic.stop + 1)
    edge = {} if run.sensitivity is None or run.projection is not None else run.sensitivity.edge(part.name)
    return {
        "name": part.name,
        "number": list(numbers),
        "hz": all_rounded(modes.omega[elastic] / (2 * np.pi)),
        "sigma": [value if value else None for value in all_rounded(modes.sigma[elastic])],
        "kind": list(modes.kind[elastic]),
        "kept": np.isin(np.arange(elastic.start, elastic.stop), part.kept).tolist(),
        "cluster": [0] * len(numbers) if modes.cluster is None else modes.cluster[elastic].tolist(),
        "edge": [list(edge.get(number, ())) for number in numbers],
    }


def _effective(curve: EffectiveMassCurve | None) -> dict[str, Any] | None:
    if curve is None or not curve.hz.size:
        return None
    return {
        "held": curve.held,
        "hz": all_rounded(curve.hz),
        "running": [all_rounded(column) for column in 100 * curve.running.T],
        "kept_hz": all_rounded(curve.kept_hz),
        "kept": [all_rounded(column) for column in 100 * curve.kept_running.T],
    }


def _gain(
    configuration: str, kept: GainSum, every: GainSum, band_hz: float, store: ArrayStore, drawn: Sequence[int]
) -> dict[str, Any]:
    """Running sums of the channels drawn in order of modes, in shares of each pair's largest."""
    size = np.maximum(abs(every.running).max(axis=0, initial=0.0), abs(kept.running).max(axis=0, initial=0.0))
    size = np.maximum(size, np.maximum(abs(kept.total), abs(every.total)))
    silent = size <= _LEAST_GAIN
    scale = np.where(silent, 1.0, size)
    return {
        "configuration": configuration,
        "hz": all_rounded(kept.hz),
        "whole_hz": all_rounded(every.hz),
        "scale": store.exact(np.where(silent, 0.0, size), "f4"),
        "running": store.rounded(_shares(kept.running, scale, drawn)),
        "whole": store.rounded(_shares(every.running, scale, drawn)),
        "total": store.exact(kept.total, "f4"),
        "whole_total": store.exact(every.total, "f4"),
        "high": high_gains(every, band_hz, store),
    }


def _shares(values: NDArray[np.float64], scale: NDArray[np.float64], drawn: Sequence[int]) -> NDArray[np.float64]:
    return np.asarray((values / scale).reshape(len(values), scale.size)[:, list(drawn)].T)


def _projection(record: ProjectionRecord) -> dict[str, Any]:
    singular = {}
    for body, values in record.singular.items():
        top = float(values.max(initial=0.0))
        singular[body] = {
            "values": all_rounded(np.maximum(values / top, _ROUNDING) if top > 0 else values),
            "rank": record.rank.get(body, 0),
        }
    return {
        "singular": singular,
        "extraneous": [
            {
                "configuration": mode.configuration,
                "hz": rounded(mode.hz),
                "weight": rounded(float(mode.weight.max(initial=0.0))),
                "body": mode.body,
                "interface": mode.interface,
                "spurious": mode.spurious,
            }
            for mode in record.extraneous
        ],
        "between": [[where, rounded(100 * error)] for where, error in record.between.items()],
        "limit": None if record.limit is None else rounded(100 * record.limit),
    }


def _timings(run: RunResult) -> dict[str, Any]:
    stages = list(dict.fromkeys(stage for part in run.components.values() for stage in part.seconds))
    return {
        "stages": stages,
        "bodies": list(run.components),
        "seconds": [[rounded(part.seconds.get(s, 0.0)) for part in run.components.values()] for s in stages],
    }
