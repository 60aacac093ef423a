"""Feedback from the sensors of a scene to its actuators."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.model import Scene

__all__ = ["feedback_gain"]


def feedback_gain(feedback: Mapping[str, Mapping[str, float]], scene: Scene) -> NDArray[np.float64]:
    """Gain matrix from sensors to actuators (inputs, outputs); zeros without feedback.

    Raises
    ------
    ConfigError
        If an actuator or sensor is not in the scene.
    """
    inputs, outputs = ([channel.name for channel in channels] for channels in (scene.actuators, scene.sensors))
    gain = np.zeros((len(inputs), len(outputs)))
    for actuator, gains in feedback.items():
        if actuator not in inputs:
            raise ConfigError(
                f"project.feedback: there is no actuator '{actuator}' (there are: {', '.join(inputs) or 'none'})"
            )
        for sensor, value in gains.items():
            if sensor not in outputs:
                raise ConfigError(
                    f"project.feedback.{actuator}: there is no sensor '{sensor}' (there are: "
                    f"{', '.join(outputs) or 'none'})"
                )
            gain[inputs.index(actuator), outputs.index(sensor)] = value
    return gain
