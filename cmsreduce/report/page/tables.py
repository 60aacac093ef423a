"""Rows of the tables on the page, as text."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from cmsreduce.model import Check, ComponentResult, HealthFinding, RunResult
from cmsreduce.report.wording import CLOSE_MODES, compared, measured, number, per_cent, seconds, worst

__all__ = [
    "BasisRow",
    "Card",
    "ChannelRow",
    "ConfigurationRow",
    "ModeRow",
    "SensitivityRow",
    "Timings",
    "basis_row",
    "cards",
    "channel_rows",
    "check_rows",
    "configuration_rows",
    "health_rows",
    "mode_rows",
    "sensitivity_rows",
    "timings",
]


@dataclass(frozen=True)
class Card:
    """One figure at the head of the page.

    Parameters
    ----------
    what : str
        Its name.
    value : str
        In words.
    more : str
        Its limit, or a value to compare with.
    state : str
        ``pass``, ``fail``, or empty without a limit.
    """

    what: str
    value: str
    more: str
    state: str = ""


def cards(run: RunResult) -> list[Card]:
    """Sizes, worst errors with their limits, speed, checks."""
    found = []
    if run.components:
        parts = run.components.values()
        elastic = sum(part.modes.elastic_count for part in parts)
        kept = sum(part.kept_modes for part in parts)
        found.append(
            Card("elastic modes kept", str(kept), f"of {elastic}, from {sum(p.full_dofs for p in parts)} dofs")
        )
    for row in worst(run, run.model):
        limit = "no limit set" if row.limit is None else f"limit {row.figure.text(row.limit)}"
        state = "" if row.met is None else "pass" if row.met else "fail"
        verdict = {"": "", "pass": "✔ ", "fail": "✘ "}[state]
        found.append(Card(f"worst {row.figure.label}", row.figure.text(row.value), f"{verdict}{limit}", state))
    if run.speed is not None and run.speed.reduced_frf_s > 0:
        times = run.speed.full_frf_s / run.speed.reduced_frf_s
        taken = f"{seconds(run.speed.full_frf_s)} → {seconds(run.speed.reduced_frf_s)}"
        found.append(Card("speed of the responses", f"× {number(times, 2)}", taken))
    checks = [check for part in run.components.values() for check in part.checks]
    if checks:
        failed = sum(not check.passed for check in checks)
        state = "fail" if failed else "pass"
        found.append(
            Card(
                "checks of the bodies",
                f"{len(checks) - failed} of {len(checks)}",
                "✘ failed some" if failed else "✔ passed",
                state,
            )
        )
    return found


@dataclass(frozen=True)
class ModeRow:
    """One mode of a body; a value that is not known is empty, the frequency of a static mode is ``static``."""

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
    """One configuration: sizes, and for every model its label and its errors in the order of `measured`."""

    name: str
    full: str
    reduced: str
    errors: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True)
class ChannelRow:
    """One actuator and one sensor: worst errors over all configurations, and the configuration with the worst."""

    name: str
    frf: str
    peak: str
    frac: str
    nrfd: str
    where: str


@dataclass(frozen=True)
class SensitivityRow:
    """One change of the sensitivity study: for each body the number of modes kept, those added, those dropped."""

    change: str
    failure: str
    bodies: tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class Timings:
    """Wall time of each stage for each body, with its sum and the peak memory."""

    stages: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...], str, str], ...]


@dataclass(frozen=True)
class BasisRow:
    """The mode set of a body; a dash for a value that is not known."""

    columns: str
    rank: str
    condition: str
    orthogonality_m: str
    orthogonality_k: str
    deficient: bool


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
            close=bool(modes.spacing[k] > CLOSE_MODES),
            kept=k in kept,
            # The reason of a mode that is left out ends with its sensitivity, which is all that is shown.
            why=modes.why[k] if k in kept else modes.why[k].partition("; ")[2],
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
            errors=tuple(
                (model, tuple(figure.text(getattr(found, figure.name)) for figure in figures))
                for model in models
                if (found := result.errors.get(model)) is not None
            ),
        )
        for result in run.configurations
    ]


def check_rows(run: RunResult) -> list[tuple[str, Check]]:
    """Checks of all bodies."""
    return [(name, check) for name, part in run.components.items() for check in part.checks]


def channel_rows(run: RunResult) -> list[ChannelRow]:
    """Errors of the run's own model by channel; empty where they were not stored."""
    results = [(c.configuration.name, c.errors[run.model]) for c in run.configurations if run.model in c.errors]
    own = [(name, each, each.channel_error, each.channel_peak) for name, each in results]
    if not own or any(error is None or peak is None for _, _, error, peak in own):
        return []
    found = []
    for y, output in enumerate(run.outputs):
        for u, entry in enumerate(run.inputs):
            # A channel that is silent in every configuration has no error.
            known = [
                (float(error[y, u]), name)
                for name, _, error, _ in own
                if error is not None and not math.isnan(error[y, u])
            ]
            worst, where = max(known, default=(math.nan, ""))
            peak = _largest(each[y, u] for _, _, _, each in own if each is not None)
            frac = -_largest(-each.frac[y, u] for _, each, _, _ in own)
            nrfd = _largest(each.channel_shift[y, u] for _, each, _, _ in own if each.channel_shift is not None)
            name = f"{entry} → {output}"
            found.append(ChannelRow(name, per_cent(worst), per_cent(peak), _known(frac, 6), per_cent(nrfd), where))
    return found


def sensitivity_rows(run: RunResult) -> list[SensitivityRow]:
    """Every case of the sensitivity study; empty without one."""
    record = run.sensitivity
    if record is None:
        return []
    found = []
    for case in record.cases:
        more, less = case.against(record.chosen)
        kept = record.chosen if case.kept is None else case.kept
        bodies = [
            (str(len(kept[body])), ", ".join(map(str, more[body])) or "–", ", ".join(map(str, less[body])) or "–")
            for body in record.chosen
        ]
        found.append(SensitivityRow(case.change, "" if case.kept is not None else case.failure, tuple(bodies)))
    return found


def timings(run: RunResult) -> Timings:
    """Wall times of all stages and bodies."""
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


def basis_row(part: ComponentResult) -> BasisRow:
    """Columns, rank and condition of a mode set, and orthogonality of the modes made of it."""
    modes, checks = part.modes, {check.name: check.value for check in part.checks}
    mass, stiffness = (checks.get(f"orthogonality in {matrix}") for matrix in "MK")
    return BasisRow(
        str(modes.basis_size),
        str(modes.basis_rank or "–"),
        number(modes.basis_condition, 3) if math.isfinite(modes.basis_condition) else "–",
        "–" if mass is None else number(mass, 2),
        "–" if stiffness is None else number(stiffness, 2),
        0 < modes.basis_rank < modes.basis_size,
    )


def health_rows(part: ComponentResult) -> list[HealthFinding]:
    """The health of a body, and its checks that failed."""
    failed = [
        HealthFinding(
            ("checks",), check.name, check.value, number(check.value, 3), check.value, check.limit, "above its limit"
        )
        for check in part.checks
        if not check.passed
    ]
    return [*part.health, *failed] if part.health else []


def _largest(values: Iterable[float]) -> float:
    """The largest number, NaN left out; NaN without any."""
    return max((float(value) for value in values if not math.isnan(value)), default=math.nan)


def _known(value: float, digits: int) -> str:
    return "" if math.isnan(value) else number(float(value), digits)
