"""Seconds of computing for a simulated second, measured over a few steps of the explicit method."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cmsreduce.model import MultibodyScene
from cmsreduce.simulate.floating_body import FloatingBody
from cmsreduce.simulate.motion import simulate_scene
from cmsreduce.simulate.scene import scene_system
from cmsreduce.simulate.time_step import longest_step

__all__ = ["measured_speed"]

# Each time is of so many steps, long beside the resolution of the clock, and is taken so many times.
_STEPS, _TIMES = 4, 5


def measured_speed(
    scene: MultibodyScene, bodies: Mapping[str, FloatingBody], band_hz: float, accuracy: float
) -> tuple[float, float]:
    """Seconds of computing for a simulated second from rest, and their relative noise.

    Parameters
    ----------
    scene : MultibodyScene
    bodies : mapping of name to FloatingBody
        As in `simulate_scene`.
    band_hz : float
        Frequency that sets the step if the bodies are rigid.
    accuracy : float
        Error of each radian of the fastest mode, which sets the step.

    Returns
    -------
    seconds : float
        Median of several times of a few steps.
    noise : float
        Half the difference between the longest and the shortest time, relative to the median.
    """
    system = scene_system(scene, bodies)
    highest = system.fastest(system.start({}, None, {})) or 2 * np.pi * band_hz
    step = longest_step(accuracy) / highest
    span = _STEPS * step
    times = [
        simulate_scene(scene, bodies, span, points=1, accuracy=accuracy, step=step).seconds_per_second
        for _ in range(_TIMES)
    ]
    middle = float(np.median(times))
    return middle, (max(times) - min(times)) / (2 * middle)
