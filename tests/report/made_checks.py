"""Findings of reduction checks made without a system, for pages as large as they get."""

from __future__ import annotations

import numpy as np

from cmsreduce.model import ChannelZeros, ControllerMargin, StepErrors, SystemChecks

__all__ = ["HEALTH", "SHIFT", "WORST_RATIO", "channel_zeros", "controller_margin", "step_of", "system_checks"]

SHIFT = 2e-4
"""The reduced system has its zeros too high by this share."""

WORST_RATIO = 0.5
"""Of the controller, at its worst frequency."""

_MASS = {"mass": [3.0, 3.0, 3.0], "centre": [0.5, 0.0, 1e-17], "inertia": np.diag([0.1, 0.2, 0.3]).tolist()}
HEALTH = {
    "mass_properties": {"geometry": _MASS, "stiffness": {**_MASS, "mass": [3.0, 3.0, 3.003]}},
    "principal": {
        "moments": [0.1, 0.2, 0.3],
        "axes": np.eye(3).tolist(),
        "radii": [1, 1, 1],
        "gyration": [0.2, 0.3, 0.4],
    },
    "rigid_motions": {"stiffness_off": 1e-12, "modes_off": 1e-11, "rigid_hz": [1e-5, -2e-5], "first_elastic_hz": 0.5},
    "grounding": {"node": 7, "force": 1e-9, "moment": 1e-9, "relative": 1e-13},
    "massless": {"count": 0, "dofs": []},
    "nearly_massless": {"count": 2, "dofs": ["3 rx", "4 rx"]},
    "highest_dof": {"dof": "9 x", "hz": 1e4},
    "stiffness_contrast": [{"kind": "translations", "ratio": 1e5, "softest": "1 x", "stiffest": "2 x"}],
    "negative_motions": {"stiffness": 0, "mass": None},
}
"""Three findings: a mass that two sources put a thousandth apart, two dofs next to massless, untold definiteness."""


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
    return ControllerMargin(name, hz, spillover, np.ones(hz.size), WORST_RATIO, float(hz[at]), 0)


def system_checks(name: str, zeros: tuple[ChannelZeros, ...], step: StepErrors) -> SystemChecks:
    """Zeros and steps of one configuration, without gains."""
    return SystemChecks(name, zeros=zeros, step=step)
