"""Figures of a run in words, the same on the terminal and on the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cmsreduce.model import ERRORS, Finding, RigidBody, RunResult, SimulationCosts

__all__ = [
    "CLOSE_MODES",
    "FIGURES",
    "MORE_FIGURES",
    "Figure",
    "channels_left_out",
    "checked",
    "compared",
    "file_name",
    "headline",
    "measured",
    "number",
    "numbers",
    "per_cent",
    "place",
    "plural",
    "rigid_words",
    "seconds",
    "simulation_words",
    "system_words",
    "worst",
    "worst_error",
]

CLOSE_MODES = 0.1
"""Half-power widths over distance above which a mode's own coefficient may mislead: neighbouring modes act together
(Gregory's coefficient holds for spacing << 1)."""

# Channels named in a line; summary.json has them all.
_NAMED = 12
# Elastic modes of the system that are named.
_FIRST = 3
# A component of a vector below this share of the largest is rounding: a centre of mass on an axis is printed on it.
_ZERO = 1e-12


@dataclass(frozen=True)
class Figure:
    """An error or a check of a run, as it is shown.

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
    Figure("channel_error", "channel error", "%", 100.0, "response error of the worst channel alone"),
    Figure("db_error", "decibel error", "dB", 1.0, "99 % of the points of a Bode plot have a smaller error"),
    Figure("frequency_error", "frequency error", "%", 100.0, "largest shift of a natural frequency in the band"),
    Figure("damping_error", "damping error", "%", 100.0, "largest error of a complex mode's damping ratio in the band"),
)
"""The errors, in the order they are shown."""

MORE_FIGURES = (
    Figure("modes_lost", "modes lost", "", 1.0, "modes in the band that only the full system has"),
    Figure("modes_extra", "modes extra", "", 1.0, "modes in the band that only the reduced system has"),
    Figure(
        "frf_error between the sampled configurations",
        "response error between",
        "%",
        100.0,
        "response error midway between the sampled angles, on a coarser grid",
    ),
    Figure("peak_error", "peak height", "%", 100.0, "largest error of the height of a channel's highest peak"),
    Figure("frac_error", "shape error (FRAC)", "", 1.0, "1 - FRAC of a channel: 0 for a response of equal shape"),
    Figure("nrfd", "peak shift (NRFD)", "%", 100.0, "largest shift of a resonance that a channel shows as a peak"),
    Figure("static_lack", "static energy error", "%", 100.0, "missing share of the strain energy of a static load"),
    Figure("gain_error", "static gain", "%", 100.0, "error of a static gain, relative to its modal gains together"),
    Figure("zero_error", "zeros", "%", 100.0, "largest shift of a transmission zero in the band"),
    Figure("zeros_lost", "zeros lost", "", 1.0, "zeros in the band that the reduced system does not have"),
    Figure("step_error", "step response", "%", 100.0, "root mean square error of a step response"),
    Figure("hinge_inertia", "hinge inertia", "%", 100.0, "largest share of a hinge's inertia lost with modes left out"),
    Figure("highest_frequency", "highest frequency", "Hz", 1.0, "highest natural frequency of the reduced system"),
    Figure("controller_ratio", "controller spillover", "", 1.0, "share of the reduced loop's margin; safe below 1"),
    Figure("controller_unstable", "unstable loop roots", "", 1.0, "unstable roots of the closed loop"),
)
"""Further checks of the run's own model, as far as the run made them."""


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


def numbers(values: ArrayLike, digits: int = 6) -> str:
    """Components of a vector, rounding shown as 0.

    Examples
    --------
    >>> numbers([0.5, 1e-17, -2.0])
    '0.5 0 -2'
    """
    array = np.asarray(values, dtype=np.float64)
    size = float(abs(array).max(initial=0.0))
    return " ".join(number(0.0 if abs(value) < _ZERO * size else float(value), digits) for value in array)


def rigid_words(body: RigidBody) -> str:
    """Mass, centre of mass and moments of inertia of a rigid body.

    Examples
    --------
    >>> rigid_words(RigidBody("hub", 6, np.array([0.06, 0, 0]), np.diag([3.0, 2.5, 2.0])))
    'rigid, mass 6, centre of mass 0.06 0 0, inertia about it, xx yy zz xy xz yz: 3 2.5 2 0 0 0'
    """
    return (
        f"rigid, mass {number(body.mass, 9)}, centre of mass {numbers(body.cg)}, "
        f"inertia about it, xx yy zz xy xz yz: {numbers(body.moments)}"
    )


def system_words(run: RunResult) -> str:
    """Rigid motions and first modes, which show a ground, a hinge or a mass that is not as meant; empty without any."""
    found = [modes for modes in run.systems if modes.rigid_count or modes.frequencies_hz.size]
    if not found:
        return ""
    counts = sorted({modes.rigid_count for modes in found})
    rigid = plural(counts[0], "rigid motion") if len(counts) == 1 else f"{counts[0]} to {counts[-1]} rigid motions"
    first, modes = found[0], "no elastic mode in the band"
    if first.frequencies_hz.size:
        modes = f"first modes {', '.join(number(float(hz)) for hz in first.frequencies_hz[:_FIRST])} Hz"
        if first.zeta is not None and first.zeta.any():
            modes += f" with {', '.join(number(100 * float(zeta), 2) for zeta in first.zeta[:_FIRST])} % damping"
    return f"system: {rigid}, those of free joints included; {modes} at {first.configuration.name}"


def per_cent(share: float, digits: int = 3) -> str:
    """A share in per cent; a dash for a share that was not measured."""
    return "–" if math.isnan(share) else f"{number(100 * share, digits)} %"


def seconds(value: float) -> str:
    """Wall time, to the millisecond below ten seconds."""
    return f"{value:.3f} s" if value < 10 else f"{value:.1f} s"


def plural(count: int, thing: str) -> str:
    """Count of things: ``1 mode``, ``2 modes``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def place(where: str) -> str:
    """Configuration, body or channel of a figure, with its preposition.

    Examples
    --------
    >>> place("spin=45"), place("as built")
    ('at spin=45', 'in the scene as built')
    """
    return f"in the scene {where}" if where.startswith("as built") else f"at {where}"


def file_name(name: str) -> str:
    """Name of a body, a channel or a configuration as part of a file's name."""
    return "".join(letter if letter.isalnum() or letter in "-=." else "_" for letter in name)


def measured(run: RunResult) -> tuple[Figure, ...]:
    """The errors that a run measured; a run without damping has no damping error."""
    errors = [found for result in run.configurations for found in result.errors.values()]
    return tuple(figure for figure in FIGURES if all(getattr(found, figure.name) is not None for found in errors))


def compared(run: RunResult) -> tuple[str, ...]:
    """Labels of the models that the run's own is compared with."""
    labels = dict.fromkeys(label for result in run.configurations for label in result.errors)
    return tuple(label for label in labels if label != run.model)


def worst(run: RunResult, model: str) -> tuple[tuple[Figure, Finding], ...]:
    """Largest value of each error of a model, with its configuration; empty if nothing was verified."""
    # Only the run's own model is judged: a limit that was not measured has no value there.
    found = run.error_findings(model, ERRORS)
    found |= {name: each for name, each in run.findings.items() if name in found and model == run.model}
    return tuple((figure, found[figure.name]) for figure in measured(run)) if found else ()


def checked(run: RunResult) -> tuple[tuple[Figure, Finding], ...]:
    """Checks of the run's own model beside the errors of its responses."""
    found = run.findings
    return tuple((figure, found[figure.name]) for figure in MORE_FIGURES if figure.name in found)


def worst_error(run: RunResult) -> str:
    """The largest response error and its configuration, in words."""
    if not (rows := worst(run, run.model)):
        return "no response was verified"
    figure, found = rows[0]
    if math.isnan(found.value):
        return "the response error was not measured"
    return f"worst response error {figure.text(found.value)} {place(found.note)}"


def _worst_channel(run: RunResult) -> str:
    """The error of the worst channel and its place, in words; empty if it was not measured."""
    rows = [(figure, found) for figure, found in worst(run, run.model) if figure.name == "channel_error"]
    return "".join(f"; worst channel {figure.text(found.value)} {place(found.note)}" for figure, found in rows)


def headline(run: RunResult) -> str:
    """The run in one sentence."""
    elastic = sum(part.modes.elastic_count for part in run.components.values())
    kept = sum(part.kept_modes for part in run.components.values())
    return f"{plural(elastic, 'elastic mode')} → {kept} kept; {worst_error(run)}{_worst_channel(run)}"


def channels_left_out(run: RunResult) -> tuple[str, ...]:
    """Channels that no error judges, with the reason."""
    found = run.left_out_channels.items()
    return tuple(f"channels left out ({reason}): {_some(names)}" for reason, names in found)


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def simulation_words(costs: SimulationCosts) -> list[str]:
    """Lines on the cost of a simulated second: of the full and of the reduced system, and their ratio."""
    lines = [
        f"a simulated second ({costs.integrator.replace('_', ' ')}, {per_cent(costs.accuracy)} in frequency, "
        f"{costs.reduced.configuration}):"
    ]
    for which, cost in (("full", costs.full), ("reduced", costs.reduced)):
        if cost is None:
            lines.append(f"{which}: highest frequency not known")
            continue
        steps = ", ".join(
            f"{number(step, 3)} s for {label.replace('_percent', ' %')}" for label, step in cost.steps.items()
        )
        line = (
            f"{which}: {number(cost.highest_hz)} Hz, longest step {steps}; {number(cost.steps_per_second, 3)} steps of "
            f"{number(cost.operations_per_step, 3)} operations"
        )
        if math.isfinite(cost.seconds):
            line += f"; {number(cost.seconds, 3)} s of computing measured (noise {per_cent(cost.noise, 2)})"
        lines.append(line)
    if costs.full is not None and costs.reduced.operations > 0:
        ratio = f"{number(costs.full.operations / costs.reduced.operations, 3)} times fewer operations"
        measured = costs.full.seconds / costs.reduced.seconds
        lines.append(ratio + (f", {number(measured, 3)} times faster as measured" if math.isfinite(measured) else ""))
    return lines
