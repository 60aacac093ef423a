"""Rows of the tables on the page, as texts by the names that the templates use."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from cmsreduce.model import ComponentResult, HealthFinding, RunResult
from cmsreduce.report.wording import CLOSE_MODES, compared, measured, number, per_cent, seconds, worst

__all__ = [
    "basis_row",
    "cards",
    "channel_rows",
    "configuration_rows",
    "health_rows",
    "mode_rows",
    "sensitivity_rows",
    "timings",
]

Row = dict[str, Any]

_UNKNOWN = "–"


def cards(run: RunResult) -> list[Row]:
    """Figures at the head of the page: sizes, worst errors with their limits, cost of a simulation, checks.

    Each has a name ``what``, a ``value``, ``more`` to compare it with, and a ``state``: pass, fail, or empty without a
    limit.
    """
    found: list[Row] = []

    def add(what: str, value: str, more: str, state: str = "") -> None:
        found.append({"what": what, "value": value, "more": more, "state": state})

    if run.components:
        parts = run.components.values()
        elastic, dofs = (sum(part.modes.elastic_count for part in parts), sum(part.full_dofs for part in parts))
        add("modes kept", str(sum(part.kept_modes for part in parts)), f"of {elastic}; {dofs} dofs")
    for figure, largest in worst(run, run.model):
        state, limit = "", "no limit set"
        if largest.judged:
            state = largest.verdict.lower()
            limit = f"{'✔' if largest.passed else '✘'} limit {figure.text(largest.limit)}"
        add(figure.label, figure.text(largest.value), limit, state)
    costs = None if run.speed is None else run.speed.simulation
    if costs is not None and costs.full is not None and costs.reduced.operations > 0:
        times = costs.full.operations / costs.reduced.operations
        add("simulation", f"÷ {number(times, 2)}", "in operations")
    passed = [check.passed for part in run.components.values() for check in part.checks]
    if passed:
        state, more = ("pass", "✔ passed") if all(passed) else ("fail", "✘ failed some")
        add("body checks", f"{sum(passed)} of {len(passed)}", more, state)
    return found


def mode_rows(part: ComponentResult) -> list[Row]:
    """Every mode of a body before truncation, in order of frequency; a value that is not known is empty."""
    modes, kept = part.modes, {int(column) for column in part.kept}
    return [
        {
            "number": k + 1,
            "hz": "static" if math.isinf(modes.omega[k]) else number(float(modes.omega[k]) / (2 * math.pi), 5),
            "kind": modes.kind[k],
            "source_hz": _known(modes.source_hz[k], 5),
            "sigma": _known(modes.sigma[k], 4),
            "spacing": _known(modes.spacing[k], 3),
            "close": bool(modes.spacing[k] > CLOSE_MODES),
            "kept": k in kept,
            # The reason of a mode that is left out ends with its sensitivity, which is all that is shown.
            "why": modes.why[k] if k in kept else modes.why[k].partition("; ")[2],
        }
        for k in range(modes.omega.size)
    ]


def configuration_rows(run: RunResult) -> list[Row]:
    """Sizes in every configuration; ``errors`` holds each model's label and its errors in the order of `measured`."""
    models, figures = (run.model, *compared(run)), measured(run)
    return [
        {
            "name": result.configuration.name,
            "full": f"{result.n_full} ({result.modes_full})",
            "reduced": f"{result.n_reduced} ({result.modes_reduced})",
            "errors": [
                (model, [figure.text(getattr(found, figure.name)) for figure in figures])
                for model in models
                if (found := result.errors.get(model)) is not None
            ],
        }
        for result in run.configurations
    ]


def channel_rows(run: RunResult) -> list[Row]:
    """Worst errors of the run's own model by actuator and sensor; empty if they were not stored.

    ``where`` is the configuration with the worst response error.
    """
    results = [(c.configuration.name, c.errors[run.model]) for c in run.configurations if run.model in c.errors]
    own = [(name, each, each.channel_errors, each.channel_peak) for name, each in results]
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
            error, where = max(known, default=(math.nan, ""))
            peak = _largest(each[y, u] for _, _, _, each in own if each is not None)
            frac = -_largest(-each.frac[y, u] for _, each, _, _ in own)
            nrfd = _largest(each.channel_shift[y, u] for _, each, _, _ in own if each.channel_shift is not None)
            row = {"name": f"{entry} → {output}", "frac": _known(frac, 6), "where": where}
            found.append(row | {"frf": per_cent(error), "peak": per_cent(peak), "nrfd": per_cent(nrfd)})
    return found


def sensitivity_rows(run: RunResult) -> list[Row]:
    """Every case of the sensitivity study, with the modes kept, added and left out in each body; empty without one."""
    record = run.sensitivity
    if record is None:
        return []
    found = []
    for case in record.cases:
        more, less = case.against(record.chosen)
        kept = record.chosen if case.kept is None else case.kept
        bodies = [
            (len(kept[body]), *(", ".join(map(str, modes[body])) or _UNKNOWN for modes in (more, less)))
            for body in record.chosen
        ]
        failure = case.failure if case.kept is None else ""
        found.append({"change": case.change, "failure": failure, "bodies": bodies})
    return found


def timings(run: RunResult) -> Row:
    """Wall times: ``stages``, and in ``rows`` each body with the time of each stage, their sum and the peak memory."""
    stages = list(dict.fromkeys(stage for part in run.components.values() for stage in part.seconds))
    rows = [
        (
            name,
            [seconds(part.seconds[stage]) if stage in part.seconds else _UNKNOWN for stage in stages],
            seconds(sum(part.seconds.values())),
            f"{part.peak_mib:.0f} MiB" if part.peak_mib else _UNKNOWN,
        )
        for name, part in run.components.items()
    ]
    return {"stages": stages, "rows": rows}


def basis_row(part: ComponentResult) -> Row:
    """Columns, rank and condition of a mode set, and orthogonality of the modes made of it."""
    modes, checks = part.modes, {check.name: check.value for check in part.checks}
    mass, stiffness = (checks.get(f"orthogonality in {matrix}") for matrix in "MK")
    return {
        "columns": modes.basis_size,
        "rank": modes.basis_rank or _UNKNOWN,
        "condition": number(modes.basis_condition, 3) if math.isfinite(modes.basis_condition) else _UNKNOWN,
        "orthogonality_m": _UNKNOWN if mass is None else number(mass, 2),
        "orthogonality_k": _UNKNOWN if stiffness is None else number(stiffness, 2),
        "deficient": 0 < modes.basis_rank < modes.basis_size,
    }


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
