"""The figures of a run in words, the same on the terminal and on the page."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cmsreduce.model import Check, ProjectionRecord, RunResult

__all__ = [
    "FIGURES",
    "Figure",
    "Worst",
    "broken",
    "checked",
    "compared",
    "headline",
    "measured",
    "number",
    "plural",
    "seconds",
    "worst",
]


@dataclass(frozen=True)
class Figure:
    """One of the errors a run is judged by.

    Parameters
    ----------
    name : str
        Key in the limits and in the summary.
    label : str
        In words.
    unit : str
        Shown behind the value.
    scale : float
        Shown value over stored value.
    meaning : str
        One line for the reader.
    """

    name: str
    label: str
    unit: str
    scale: float
    meaning: str

    def text(self, value: float) -> str:
        """Value with its unit."""
        if not math.isfinite(value):
            return number(value)
        return f"{number(self.scale * value, 3)} {self.unit}".rstrip()


FIGURES = (
    Figure("frf_error", "response error", "%", 100.0, "relative error of the elastic response over the band"),
    Figure("db_error", "decibel error", "dB", 1.0, "99 % of the points of a Bode plot lie closer than this"),
    Figure("frequency_error", "frequency error", "%", 100.0, "largest shift of a natural frequency in the band"),
    Figure("damping_error", "damping error", "%", 100.0, "largest error of a complex mode's damping ratio in the band"),
)
"""The errors, in the order they are shown."""

MORE_FIGURES = (
    Figure("peak_error", "peak height", "%", 100.0, "largest error of the height of a channel's highest peak"),
    Figure("frac_error", "1 - FRAC", "", 1.0, "how unlike the response of a channel is in shape"),
    Figure("nrfd", "peak shift (NRFD)", "%", 100.0, "largest shift of a resonance that a channel shows as a peak"),
    Figure("static_lack", "static energy lacking", "%", 100.0, "strain energy that a static load on a body misses"),
    Figure("gain_error", "static gain", "%", 100.0, "error of a static gain, relative to its modal gains together"),
    Figure("zero_error", "zeros", "%", 100.0, "largest shift of a transmission zero in the band"),
    Figure("zeros_lost", "zeros lost", "", 1.0, "zeros in the band that the reduced system has not"),
    Figure("step_error", "step response", "%", 100.0, "root mean square error of a step response"),
    Figure("controller_ratio", "controller spillover", "", 1.0, "sigma_max(dG K) / sigma_min(I + G_R K); safe below 1"),
    Figure("controller_unstable", "unstable loop roots", "", 1.0, "roots of the reduced closed loop that grow"),
)
"""What is measured of the run's own model beside them, as far as it was asked for."""


@dataclass(frozen=True)
class Worst:
    """The largest of one error of one model.

    Parameters
    ----------
    figure : Figure
        Which error.
    value : float
        Its largest value.
    where : str
        Name of the configuration.
    limit : float or None
        Of the run, if one is set.
    """

    figure: Figure
    value: float
    where: str
    limit: float | None

    @property
    def met(self) -> bool | None:
        """Whether the limit is met; None without one."""
        return None if self.limit is None else Check(self.figure.name, self.value, self.limit).passed


def number(value: float, digits: int = 4) -> str:
    """Value to some significant digits, without an exponent where a person would write none.

    Examples
    --------
    >>> number(1234.567), number(0.000123456), number(1.5e-7)
    ('1235', '0.0001235', '1.5e-07')
    """
    if math.isnan(value):
        return "no value"
    if math.isinf(value):
        return "infinite" if value > 0 else "-infinite"
    return f"{value:.0f}" if 10 ** (digits - 1) <= abs(value) < 1e7 else f"{value:.{digits}g}"


def seconds(value: float) -> str:
    """Wall time, to the millisecond where that tells something."""
    return f"{value:.3f} s" if value < 10 else f"{value:.1f} s"


def plural(count: int, thing: str) -> str:
    """Count of things: ``1 mode``, ``2 modes``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def measured(run: RunResult) -> tuple[Figure, ...]:
    """The errors that a run measured: one without damping has no damping error."""
    errors = [found for result in run.configurations for found in result.errors.values()]
    return tuple(figure for figure in FIGURES if all(getattr(found, figure.name) is not None for found in errors))


def compared(run: RunResult) -> tuple[str, ...]:
    """Labels of the models the run's own is compared with."""
    labels = dict.fromkeys(label for result in run.configurations for label in result.errors)
    return tuple(label for label in labels if label != run.model)


def worst(run: RunResult, model: str) -> tuple[Worst, ...]:
    """Largest of each error of a model over all configurations, and where; empty if nothing was verified."""
    found = [result for result in run.configurations if model in result.errors]
    rows = []
    for figure in measured(run) if found else ():
        values = [float(getattr(result.errors[model], figure.name)) for result in found]
        # A value that is no number is worse than any that is one.
        at = max(range(len(values)), key=lambda k: math.inf if math.isnan(values[k]) else values[k])
        rows.append(Worst(figure, values[at], found[at].configuration.name, run.limits.get(figure.name)))
    return tuple(rows)


def checked(run: RunResult) -> tuple[Worst, ...]:
    """What was measured of the run's own model beside the errors of its responses."""
    found = run.figures
    return tuple(
        Worst(figure, found[figure.name].value, found[figure.name].where, found[figure.name].limit)
        for figure in MORE_FIGURES
        if figure.name in found
    )


def headline(run: RunResult) -> str:
    """The run in one sentence."""
    elastic = sum(part.modes.elastic_count for part in run.components.values())
    kept = sum(part.kept_modes for part in run.components.values())
    modes = f"{plural(elastic, 'elastic mode')} → {kept} kept"
    found = worst(run, run.model)
    if not found:
        return f"{modes}; no response was verified"
    return f"{modes}; worst response error {found[0].figure.text(found[0].value)} at {found[0].where}"


def broken(run: RunResult) -> tuple[str, ...]:
    """Every limit and check that is not met, in words."""
    limits = [
        f"{w.figure.label} {w.figure.text(w.value)} at {w.where} is above its limit {w.figure.text(w.limit)}"
        for w in worst(run, run.model)
        if w.limit is not None and not w.met
    ]
    limits += [
        f"{w.figure.label} {w.figure.text(w.value)} at {w.where} is above its limit {w.figure.text(w.limit)}"
        for w in checked(run)
        if w.limit is not None and not w.met
    ]
    limits += _halfway(run.projection)
    checks = [
        f"{name}: {check.name} is {number(check.value)}, above its limit {number(check.limit)}"
        for name, part in run.components.items()
        for check in part.checks
        if not check.passed
    ]
    return (*limits, *checks)


def _halfway(record: ProjectionRecord | None) -> list[str]:
    """The error halfway between angles, where it is above what was asked for."""
    worst = None if record is None else record.worst_between
    if record is None or worst is None or record.limit is None or record.passed:
        return []
    figure = FIGURES[0]
    return [f"{figure.label} {figure.text(worst[1])} at {worst[0]} is above its limit {figure.text(record.limit)}"]
