"""Errors between the sampled configurations: at angles midway between those that the scene names."""

from __future__ import annotations

import numpy as np

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import DOF_NAMES, BetweenErrors, Configuration, Scene
from cmsreduce.pipeline.system.comparison import Comparison, ReducedModel

__all__ = ["errors_between", "judged_midpoints", "midpoint_configurations"]


def errors_between(comparison: Comparison, model: ReducedModel, most: int | None) -> BetweenErrors:
    """Response errors of a reduced model at midpoint configurations, on grids refined at its own resonances.

    Parameters
    ----------
    comparison : Comparison
        With the reference model.
    model : ReducedModel
    most : int, optional
        Largest number of midpoint configurations; of more, as many at even distances in their list are taken. All by
        default.
    """
    there, left_out = judged_midpoints(comparison, model, most)
    errors = comparison.quick_errors(there, model)
    midpoints = len(midpoint_configurations(comparison.scene))
    return BetweenErrors(dict(zip((each.name for each in there), errors, strict=True)), midpoints, left_out)


def judged_midpoints(
    comparison: Comparison, model: ReducedModel, most: int | None
) -> tuple[list[Configuration], tuple[str, ...]]:
    """Midpoint configurations where errors are measured, and those that cannot be reached, each with the reason."""
    every = midpoint_configurations(comparison.scene)
    some = every if most is None else [every[k] for k in _even(len(every), most)]
    there, left_out = [], []
    for each in some:
        try:
            # A loop may not close at an angle that the scene does not name.
            _ = comparison.reference.wiring(each), model.assembled.wiring(each)
            there.append(each)
        except CmsReduceError as error:
            left_out.append(f"{each.name}: {error}")
    return there, tuple(left_out)


def _even(count: int, most: int) -> list[int]:
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, most)).round()}) if count and most else []


def midpoint_configurations(scene: Scene) -> list[Configuration]:
    """Configurations midway between neighbouring ones of the scene that differ in one angle only.

    A configuration that differs from all others in several angles has none of these: it is joined to the next one in
    the list of the scene, as on a path.

    Parameters
    ----------
    scene : Scene
        Its configurations need not fill a grid.
    """
    found: dict[tuple[float, ...], Configuration] = {}
    axes = sorted({axis for configuration in scene.configurations for axis in configuration.angles})
    sampled = [tuple(each.angles.get(axis, 0.0) for axis in axes) for each in scene.configurations]

    def add(middle: tuple[float, ...]) -> None:
        label = " ".join(_shown(axis, value) for axis, value in zip(axes, middle, strict=True))
        found.setdefault(middle, Configuration(f"midpoint {label}", dict(zip(axes, middle, strict=True))))

    for number, here in enumerate(sampled):
        alone = True
        for k, _ in enumerate(axes):
            others = [there[k] for there in sampled if there[:k] + there[k + 1 :] == here[:k] + here[k + 1 :]]
            beyond = [angle for angle in others if angle > here[k]]
            alone &= all(angle == here[k] for angle in others)
            if beyond:
                add((*here[:k], (here[k] + min(beyond)) / 2, *here[k + 1 :]))
        if alone and number + 1 < len(sampled) and sampled[number + 1] != here:
            add(tuple((a + b) / 2 for a, b in zip(here, sampled[number + 1], strict=True)))
    return list(found.values())


def _shown(axis: tuple[str, int], value: float) -> str:
    joint, dof = axis
    size = f"{np.degrees(value):.4g}" if dof >= len(DOF_NAMES) // 2 else f"{value:.4g}"
    return f"{joint}.{DOF_NAMES[dof]}={size}"
