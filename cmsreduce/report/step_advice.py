"""What steps a run's highest frequencies ask of integrators, in lines."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

import numpy as np

from cmsreduce.linalg.integrator_steps import advised_steps
from cmsreduce.model import RunResult
from cmsreduce.report.wording import number

__all__ = ["step_lines"]

# Central differences step through the same displacements as modified Euler, and need the same steps.
_NAMES = {
    "modified_euler": "central differences, modified Euler",
    "trapezoidal": "trapezoidal",
    "generalised_alpha": "generalised alpha",
    "rk4": "Runge-Kutta 4",
    "ab2": "AB-2",
}
# Columns of a log.
_WIDTH = 98


def step_lines(run: RunResult) -> Iterator[str]:
    """Highest frequency of each body and of the assembly at its worst configuration, and steps for the latter."""
    highest = {name: part.highest_hz for name, part in run.components.items() if part.highest_hz > 0}
    if not highest:
        return
    assembled = [modes for modes in run.systems if modes.highest_hz]
    worst = max(assembled, key=lambda modes: modes.highest_hz or 0.0, default=None)
    parts = [f"{name} {number(hz)} Hz" for name, hz in highest.items()]
    top, of = max(highest.values()), "the highest of these"
    if worst is not None and worst.highest_hz is not None:
        top, of = worst.highest_hz, "the assembly's"
        parts.append(f"assembly {number(top)} Hz ({worst.configuration.name})")
    yield from textwrap.wrap(f"highest frequencies: {', '.join(parts)}", _WIDTH, subsequent_indent="  ")
    yield f"longest steps that keep {of} to 1 % and 0.1 %, and that are stable:"
    steps = advised_steps(2 * np.pi * top)
    for name, label in _NAMES.items():
        each = steps[name]
        if each["stable"] == 0:
            stable = "none for undamped modes"
        else:
            stable = "any" if np.isinf(each["stable"]) else number(each["stable"], 3)
        yield f"  {label:<37}{number(each['1_percent'], 3):<11}{number(each['0.1_percent'], 3):<11}{stable}"
