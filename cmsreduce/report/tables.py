"""Rows of the tables on the page."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cmsreduce.model import Check, ComponentResult, ConfigurationResult, RunResult
from cmsreduce.report.wording import Figure, compared, measured, number, seconds

__all__ = ["ConfigurationRow", "ModeRow", "Timings", "check_rows", "configuration_rows", "mode_rows", "timings"]

# Above this, neighbouring modes act together and a mode's own coefficient may mislead (validity of Gregory's
# coefficient: spacing << 1).
_CLOSE = 0.1


@dataclass(frozen=True)
class ModeRow:
    """One mode of a body, as text; empty where there is nothing to say, ``static`` where a mode has no frequency."""

    number: int
    hz: str
    kind: str
    source_hz: str
    sigma: str
    spacing: str
    close: bool
    kept: bool
    why: str


@dataclass(frozen=True)
class ConfigurationRow:
    """One configuration: sizes, and of every model its label and its errors in the order of `measured`."""

    name: str
    full: str
    reduced: str
    errors: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class Timings:
    """Seconds of each stage for each body."""

    stages: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...], str, str], ...]


def mode_rows(part: ComponentResult) -> list[ModeRow]:
    """Every mode of a body before truncation, in order of frequency."""
    modes, kept = part.modes, {int(column) for column in part.kept}
    return [
        ModeRow(
            number=k + 1,
            hz="static" if math.isinf(modes.omega[k]) else number(float(modes.omega[k]) / (2 * math.pi), 5),
            kind=modes.kind[k],
            source_hz=_known(modes.source_hz[k], 5),
            sigma=_known(modes.sigma[k], 4),
            spacing=_known(modes.spacing[k], 3),
            close=bool(modes.spacing[k] > _CLOSE),
            kept=k in kept,
            why=modes.why[k] if k in kept else "",
        )
        for k in range(modes.omega.size)
    ]


def configuration_rows(run: RunResult) -> list[ConfigurationRow]:
    """Errors of every model in every configuration."""
    models, figures = (run.model, *compared(run)), measured(run)
    return [
        ConfigurationRow(
            name=result.configuration.name,
            full=f"{result.n_full} ({result.modes_full})",
            reduced=f"{result.n_reduced} ({result.modes_reduced})",
            errors=tuple((model, _errors(result, model, figures)) for model in models if model in result.errors),
        )
        for result in run.configurations
    ]


def check_rows(run: RunResult) -> list[tuple[str, Check]]:
    """Checks of all bodies."""
    return [(name, check) for name, part in run.components.items() for check in part.checks]


def timings(run: RunResult) -> Timings:
    """Wall time of every stage of every body, its sum, and the peak memory."""
    stages = tuple(dict.fromkeys(stage for part in run.components.values() for stage in part.seconds))
    rows = tuple(
        (
            name,
            tuple(seconds(part.seconds[stage]) if stage in part.seconds else "–" for stage in stages),
            seconds(sum(part.seconds.values())),
            f"{part.peak_mib:.0f} MiB" if part.peak_mib else "–",
        )
        for name, part in run.components.items()
    )
    return Timings(stages, rows)


def _errors(result: ConfigurationResult, model: str, figures: tuple[Figure, ...]) -> tuple[str, ...]:
    return tuple(figure.text(getattr(result.errors[model], figure.name)) for figure in figures)


def _known(value: float, digits: int) -> str:
    return "" if math.isnan(value) else number(float(value), digits)
