"""Findings of reduction checks made without a system, for pages as large as they get."""

from __future__ import annotations

import numpy as np

from cmsreduce.model import ChannelZeros, ControllerMargin, HealthFinding, StepErrors, SystemChecks

__all__ = ["HEALTH", "SHIFT", "WORST_RATIO", "channel_zeros", "controller_margin", "step_of", "system_checks"]

SHIFT = 2e-4
"""The reduced system has its zeros too high by this share."""

WORST_RATIO = 0.5
"""Largest quotient of the controller, at its worst frequency."""

HEALTH = (
    HealthFinding(("mass_properties", "geometry", "centre"), "centre of mass", [0.5, 0.0, 0.0], "0.5 0 0"),
    HealthFinding(
        ("mass_properties", "stiffness"),
        "mass by the rigid motions of stiffness",
        {"mass": [3.0, 3.0, 3.003]},
        "differs by 0.001, relative",
        1e-3,
        1e-5,
        "the sources disagree",
    ),
    HealthFinding(("rigid_motions", "rigid_hz"), "rigid modes", [1e-5, -2e-5], "below 2e-05 Hz", 2e-5, 5e-3, "no gap"),
    HealthFinding(
        ("nearly_massless",),
        "nearly massless dofs",
        {"count": 2, "dofs": ["3 rx", "4 rx"]},
        "2: 3 rx 4 rx",
        2.0,
        0.0,
        "they cost time steps",
    ),
    HealthFinding(
        ("stiffness_contrast",), "stiffness of translations", {"ratio": 1e5, "softest": "1 x"}, "ratio 1e+05", 1e5, 1e12
    ),
    HealthFinding(("stiffness_contrast",), "stiffness of rotations", {"ratio": 10.0}, "ratio 10", 10.0, 1e12),
    HealthFinding(
        ("negative_motions", "mass"),
        "motions of negative energy, mass",
        None,
        "not determined",
        np.nan,
        0.0,
        "a large body",
    ),
)
"""Three limits not met: a mass that two sources put a thousandth apart, two nearly massless dofs, an unknown."""


def channel_zeros(hz: np.ndarray, kept: int, outputs: int, inputs: int) -> tuple[ChannelZeros, ...]:
    """A zero between every two poles, a real pair above them; those of the reduced system up to its last mode."""
    between = 2j * np.pi * np.sqrt(hz[:-1] * hz[1:])
    pair = 2 * np.pi * hz[3] * np.array([1, -1])
    full, reduced = np.concatenate([between, pair]), np.concatenate([between[: kept - 1], pair]) * (1 + SHIFT)
    judged = np.arange(kept - 1)
    shift = np.full(judged.size, SHIFT)
    return tuple(ChannelZeros(y, u, full, reduced, shift, judged) for y in range(outputs) for u in range(inputs))


def step_of(hz: np.ndarray, C: np.ndarray, B: np.ndarray, kept: int, zeta: float) -> StepErrors:
    """c b / w^2 (1 - exp(-zeta w t) cos w t), summed over the modes: the step response at small damping."""
    time = np.linspace(0, 8 / hz[0], 400)
    w = 2 * np.pi * hz
    mode = (1 - np.exp(-zeta * w * time[:, None]) * np.cos(w * time[:, None])) / w**2
    full, reduced = (
        np.einsum("ok,tk,ik->toi", C[:, :n], mode[:, :n], B[:, :n], optimize=True) for n in (hz.size, kept)
    )
    miss = abs(reduced - full)
    return StepErrors(
        time, full, reduced, miss.max(axis=0) / abs(full).max(axis=0), miss.std(axis=0) / full.std(axis=0)
    )


def controller_margin(name: str, hz: np.ndarray, worst_hz: float) -> ControllerMargin:
    """A spillover with one peak under a flat bound."""
    at = int(abs(hz - worst_hz).argmin())
    spillover = WORST_RATIO / (1 + (50 * (hz / hz[at] - 1)) ** 2)
    return ControllerMargin(name, hz, spillover, np.ones(hz.size), 0, unstable_full=0)


def system_checks(name: str, zeros: tuple[ChannelZeros, ...], step: StepErrors) -> SystemChecks:
    """Zeros and steps of one configuration, without gains."""
    return SystemChecks(name, zeros=zeros, step=step)
