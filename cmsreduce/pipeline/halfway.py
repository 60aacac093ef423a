"""Settings of the joints between those that a scene names."""

from __future__ import annotations

import numpy as np

from cmsreduce.model import DOF_NAMES, Configuration, Scene

__all__ = ["halfway"]

_ROTATIONS = 3


def halfway(scene: Scene) -> list[Configuration]:
    """Configurations midway between those of the scene that differ in one angle and are neighbours in it.

    Parameters
    ----------
    scene : Scene
        Its configurations need not fill a grid.
    """
    found: dict[tuple[float, ...], Configuration] = {}
    axes = sorted({axis for setting in scene.configurations for axis in setting.angles})
    settings = [tuple(setting.angles.get(axis, 0.0) for axis in axes) for setting in scene.configurations]
    for here in settings:
        for k, _ in enumerate(axes):
            others = [there[k] for there in settings if there[:k] + there[k + 1 :] == here[:k] + here[k + 1 :]]
            beyond = [angle for angle in others if angle > here[k]]
            if beyond:
                middle = (*here[:k], (here[k] + min(beyond)) / 2, *here[k + 1 :])
                label = " ".join(_shown(axis, value) for axis, value in zip(axes, middle, strict=True))
                angles = dict(zip(axes, middle, strict=True))
                found.setdefault(middle, Configuration(f"halfway {label}", angles))
    return list(found.values())


def _shown(axis: tuple[str, int], value: float) -> str:
    joint, dof = axis
    size = f"{np.degrees(value):.4g}" if dof >= _ROTATIONS else f"{value:.4g}"
    return f"{joint}.{DOF_NAMES[dof]}={size}"
