"""Parts of summary.json on channels, modes, static loads, gains, zeros, steps and control."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cmsreduce.model import (
    ComponentResult,
    ConfigurationResult,
    GainSum,
    ModelErrors,
    RunResult,
    StepErrors,
    SystemChecks,
)

__all__ = ["basis", "channels", "controller", "figures", "pole_pairs", "static_lack", "system_checks", "unpaired"]

# Steps of a running sum below this share of the total are not visible in a plot. With more pairs of channels, the sums
# are left out, because a summary is read by people and small programs.
_SHOWN, _PAIRS = 0.01, 200


def figures(run: RunResult) -> dict[str, dict[str, Any]]:
    """Errors and checks by name: worst value, its place, limit, and verdict (None without a limit)."""
    return {
        name: {
            "value": each.value,
            "where": each.note,
            "limit": each.limit if each.judged else None,
            "passed": each.passed if each.judged else None,
        }
        for name, each in run.findings.items()
    }


def basis(part: ComponentResult) -> dict[str, Any]:
    """Rank and condition of a body's mode set, and how orthogonal the modes made of it are."""
    modes, checks = part.modes, {check.name: check.value for check in part.checks}
    return {
        "columns": modes.basis_size,
        "rank": modes.basis_rank or None,
        "condition": modes.basis_condition,
        "orthogonality_m": checks.get("orthogonality in M"),
        "orthogonality_k": checks.get("orthogonality in K"),
    }


def static_lack(loads: Mapping[str, float] | None) -> list[dict[str, Any]] | None:
    """Share of strain energy that a reduced body misses under each load; None if not computed."""
    return None if loads is None else [{"load": load, "lack": lack} for load, lack in loads.items()]


def channels(run: RunResult, errors: ModelErrors | None) -> list[dict[str, Any]] | None:
    """Errors of each channel."""
    if errors is None or errors.channel_errors is None or errors.channel_peak is None:
        return None
    return [
        {
            "output": run.outputs[y],
            "input": run.inputs[u],
            "frf_error": errors.channel_errors[y, u],
            "peak_error": errors.channel_peak[y, u],
            "frac": errors.frac[y, u],
            "nrfd": None if errors.channel_shift is None else errors.channel_shift[y, u],
            "judged": None if errors.loud is None else errors.loud[y, u],
        }
        for y, u in np.ndindex(errors.frac.shape)
    ]


def pole_pairs(errors: ModelErrors | None) -> list[dict[str, float]] | None:
    """Natural frequencies of the reduced system in the band, each with its partner in the reference model."""
    if errors is None:
        return None
    columns = (errors.full_hz, errors.reduced_hz, errors.mac, errors.shift)
    names = ("full_hz", "reduced_hz", "mac", "nrfd")
    return [dict(zip(names, row, strict=True)) for row in np.column_stack(columns).tolist()]


def unpaired(run: RunResult, errors: ModelErrors | None) -> dict[str, Any]:
    """Modes in the band that one of the two models lacks."""
    every = {"modes_lost": () if errors is None else errors.lost, "modes_extra": () if errors is None else errors.extra}
    return {
        name: [
            {
                "hz": each.hz,
                "body": each.body,
                "energy_share": each.share,
                "peak_share": each.seen,
                "output": None if each.channel is None else run.outputs[each.channel[0]],
                "input": None if each.channel is None else run.inputs[each.channel[1]],
            }
            for each in modes
        ]
        for name, modes in every.items()
    }


def system_checks(run: RunResult, result: ConfigurationResult) -> dict[str, Any] | None:
    """Gains, zeros and steps in one configuration; None if none was computed."""
    every = () if run.checks is None else run.checks.systems
    found = next((each for each in every if each.configuration == result.configuration.name), None)
    if found is None:
        return None
    running = len(every) * len(run.inputs) * len(run.outputs) <= _PAIRS
    return {
        "gains": _gains(run, found, running=running),
        "high_gain_modes": _high(run, found),
        "zeros": _zeros(run, found),
        "step": None if found.step is None else _step(run, found.step),
    }


def controller(run: RunResult) -> list[dict[str, Any]] | None:
    """Spillover of the scene's controller in each configuration; None without a controller."""
    if not run.margins:
        return None
    return [
        {
            "configuration": each.configuration,
            "ratio": each.ratio,
            "margin": 1 / each.ratio if each.ratio > 0 else None,
            "worst_hz": each.worst_hz,
            "unstable_roots": each.unstable,
            "unstable_roots_full": each.unstable_full,
            "proven": each.proven,
        }
        for each in run.margins
    ]


def _gains(run: RunResult, found: SystemChecks, *, running: bool) -> list[dict[str, Any]] | None:
    full, reduced, errors = found.full_gains, found.reduced_gains, found.gain_errors
    if full is None or reduced is None or errors is None:
        return None
    return [
        {
            "output": run.outputs[y],
            "input": run.inputs[u],
            "full": full.total[y, u],
            "reduced": reduced.total[y, u],
            "error": errors[y, u],
            "running": {"full": _running(full, y, u), "reduced": _running(reduced, y, u)} if running else None,
        }
        for y, u in np.ndindex(errors.shape)
    ]


def _running(gains: GainSum, y: int, u: int) -> dict[str, list[float]]:
    """Running sum at the modes that change it visibly, and at the last mode."""
    seen = abs(gains.gain[:, y, u]) > _SHOWN * gains.size[y, u]
    seen[-1:] = True
    return {"hz": gains.hz[seen].tolist(), "sum": gains.running[seen, y, u].tolist()}


def _high(run: RunResult, found: SystemChecks) -> list[dict[str, Any]] | None:
    if found.full_gains is None or found.reduced_gains is None:
        return None
    return [
        {
            "system": system,
            "output": run.outputs[each.output],
            "input": run.inputs[each.input],
            "hz": each.hz,
            "gain": each.gain,
            "share": each.share,
        }
        for system, gains in (("full", found.full_gains), ("reduced", found.reduced_gains))
        for each in gains.high_gain_modes(run.band[1])
    ]


def _zeros(run: RunResult, found: SystemChecks) -> list[dict[str, Any]] | None:
    if found.zeros is None:
        return None
    return [
        {
            "output": run.outputs[pair.output],
            "input": run.inputs[pair.input],
            "full_hz": _complex_hz(pair.full),
            "reduced_hz": _complex_hz(pair.reduced),
            "error": pair.worst,
            "lost": pair.lost,
        }
        for pair in found.zeros
    ]


def _complex_hz(zeros: Any) -> list[list[float]]:
    """Real and imaginary part divided by 2 pi; a zero on the frequency axis is [0, f]."""
    return [[float(z.real) / (2 * np.pi), float(z.imag) / (2 * np.pi)] for z in zeros]


def _step(run: RunResult, step: StepErrors) -> list[dict[str, Any]]:
    return [
        {
            "output": run.outputs[y],
            "input": run.inputs[u],
            "peak_error": step.peak[y, u],
            "rms_error": step.rms[y, u],
        }
        for y, u in np.ndindex(step.rms.shape)
    ]
