"""The next thing to try after a broken limit, from what the run knows: modes left out, mode set, cutoff, mode."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from cmsreduce.model import Finding, RunResult
from cmsreduce.report.wording import FIGURES, number, plural, worst

__all__ = ["next_steps"]

# A cutoff of less than this multiple of the band leaves its upper modes inaccurate: Rubin and Craig advise 1.5 to 2.
_LOW_CUTOFF = 1.5
# Factor from one cutoff to the next one to try.
_HIGHER = 2.0
# Errors of responses and modes: more or better modes lower them.
_OF_MODES = frozenset(
    [figure.name for figure in FIGURES]
    + ["modes_lost", "peak_error", "frac_error", "nrfd", "zero_error", "zeros_lost", "step_error", "controller_ratio"]
    + ["frf_error between the sampled configurations"]
)
# Those that the peaks of undamped modes decide, which are infinite: two peaks that do not meet differ by as much as
# both hold, whatever the shift of a frequency.
_OF_PEAKS = frozenset(
    ["frf_error", "channel_error", "peak_error", "frac_error", "frf_error between the sampled configurations"]
)


def next_steps(run: RunResult) -> tuple[str, ...]:
    """Say what to try, one sentence for each cause of broken limits; empty if no remedy is known.

    Parameters
    ----------
    run : RunResult
        With a verdict of FAIL.

    Notes
    -----
    Modes that were computed and left out come first, because they cost no new reduction. If all modes of the mode sets
    were kept, another mode set of the comparison that meets the limit is named, then the cutoff.
    """
    return tuple(dict.fromkeys(step for found in run.verdict.broken for step in _steps(run, found)))


def _steps(run: RunResult, found: Finding) -> Iterator[str]:
    if math.isnan(found.value):
        yield from _to_measure(run)
    elif found.name == "static_lack" or found.name == "gain_error":
        given = (run.settings.get("reduce") or {}).get("residuals") or ()
        if not {"actuators", "sensors"} <= set(given):
            yield (
                "static responses: add residual vectors, `reduce: {residuals: [actuators, sensors]}`, which make them "
                "exact"
            )
    elif found.name in _OF_PEAKS and _undamped(run):
        yield (
            "nothing in the system is damped: its responses are infinite at every natural frequency, and the smallest "
            "shift of one is an error of 100 % and more. Give the bodies their damping, such as "
            "`damping: {modal: 0.005}`"
        )
    elif found.name in _OF_MODES:
        yield _to_improve(run, found)


def _undamped(run: RunResult) -> bool:
    """True if neither a body nor a joint has damping."""
    measured = [result.errors[run.model] for result in run.configurations if run.model in result.errors]
    still = all(not part.modes.zeta.any() for part in run.components.values())
    return still and all(errors.damped is None for errors in measured)


def _to_measure(run: RunResult) -> Iterator[str]:
    """A limit that was not measured for want of channels."""
    missing = [kind for kind, names in (("actuators", run.inputs), ("sensors", run.outputs)) if not names]
    if missing:
        yield f"name the scene's {' and '.join(missing)} under `scene:`"


def _to_improve(run: RunResult, found: Finding) -> str:
    parts = run.components.values()
    kept, whole = sum(part.kept_modes for part in parts), sum(part.modes.elastic_count for part in parts)
    searched = "limits" in ((run.settings.get("balance") or {}).get("keep") or {})
    if kept < whole and run.projection is None and not searched:
        return (
            f"{plural(whole - kept, 'mode')} of the mode sets {'was' if whole - kept == 1 else 'were'} left out: "
            "`balance: {keep: limits}` finds the fewest modes that meet every limit"
        )
    for label in _better(run, found):
        keys = run.settings.get("verify", {}).get("compare", {}).get(label, {}).get("reduce")
        if keys:
            return f"the compared model '{label}' meets this limit: `reduce: {_flow(keys)}`"
    if {part.modes.method for part in parts} == {"scene"}:
        return (
            "scene shapes are made for `frf_error`: state a smaller limit of it, which they are made for then, or take "
            "`reduce: {method: macneal-rubin}`"
        )
    every = "all modes of the mode sets"
    found_by = f"the search could choose among {every}" if searched else f"{every} were kept"
    if (cutoff := _cutoff(run)) is None:
        return f"{found_by}: raise `reduce.cutoff`"
    short = f", which is short for a band up to {number(run.band[1])} Hz" if cutoff < _LOW_CUTOFF else ""
    return (
        f"{found_by}: raise `reduce.cutoff` from {number(cutoff)}{short} to "
        f"{number(max(_HIGHER * cutoff, _HIGHER))}{_other_method(run)}"
    )


def _better(run: RunResult, found: Finding) -> Iterator[str]:
    """Labels of compared models that meet a limit, in the order of the pipeline file."""
    labels = dict.fromkeys(label for result in run.configurations for label in result.errors if label != run.model)
    for label in labels:
        values = {figure.name: each.value for figure, each in worst(run, label)}
        if values.get(found.name, math.inf) <= found.limit:
            yield label


def _cutoff(run: RunResult) -> float | None:
    """Lowest cutoff of the bodies, as a multiple of the band; None if it was found by the run itself."""
    common, *others = _mode_set_keys(run)
    every = [{"cutoff": 2.0, **common, **own}["cutoff"] for own in others or [{}]]
    known = [float(value) for value in every if isinstance(value, (int, float))]
    return min(known) if len(known) == len(every) else None


def _mode_set_keys(run: RunResult) -> list[Mapping[str, Any]]:
    """Keys of the mode sets: those of the run, then those of single bodies."""
    components = run.settings.get("components", {})
    return [run.settings.get("reduce") or {}] + [
        (components.get(name, {}) or {}).get("reduce") or {} for name in run.components
    ]


def _other_method(run: RunResult) -> str:
    """The mode set whose error falls faster with the cutoff, if the run does not have it."""
    methods = {part.modes.method for part in run.components.values()}
    if methods == {"guyan"}:
        return ", with `method: craig-bampton`: guyan has no normal modes"
    if "macneal-rubin" in methods:
        return ""
    if methods != {"craig-bampton"} or any(keys.get("inertia") for keys in _mode_set_keys(run)):
        return ", or take `method: macneal-rubin`"
    return ", or take `method: macneal-rubin` or `inertia: true`, whose error in the band is often far smaller"


def _flow(keys: Mapping[str, Any]) -> str:
    """Keys as YAML in braces."""
    return "{" + ", ".join(f"{key}: {value}" for key, value in keys.items()) + "}"
