"""Errors between the sampled configurations: at angles and parameters midway between those that the scene names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import DOF_NAMES, BetweenErrors, Configuration, Scene, parameter_label
from cmsreduce.pipeline.system.comparison import Comparison
from cmsreduce.pipeline.system.reduced_model import ReducedModel

__all__ = ["errors_between", "judged_midpoints", "midpoint_configurations"]

Axis = tuple[str, int]
"""Joint and its motion 0..5, or the name of a parameter and `_PARAMETER`."""

_PARAMETER = -1


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
    found = dict(zip((each.name for each in there), comparison.quick_errors(there, model), strict=True))
    midpoints = len(midpoint_configurations(comparison.scene))
    if found and any(each.parameters for each in comparison.scene.configurations):
        # The error may be larger beside the midpoint that errs most: halfway to its neighbours.
        worst = max(found, key=lambda name: found[name])
        beside = _beside(next(each for each in there if each.name == worst), comparison.scene)
        near, out = _reachable(beside, comparison, model)
        found |= dict(zip((each.name for each in near), comparison.quick_errors(near, model), strict=True))
        midpoints, left_out = midpoints + len(beside), (*left_out, *out)
    return BetweenErrors(found, midpoints, left_out)


def judged_midpoints(
    comparison: Comparison, model: ReducedModel, most: int | None
) -> tuple[list[Configuration], tuple[str, ...]]:
    """Midpoint configurations where errors are measured, and those that cannot be reached, each with the reason."""
    every = midpoint_configurations(comparison.scene)
    some = every if most is None else [every[k] for k in _even(len(every), most)]
    return _reachable(some, comparison, model)


def _reachable(
    some: Sequence[Configuration], comparison: Comparison, model: ReducedModel
) -> tuple[list[Configuration], tuple[str, ...]]:
    """Configurations that can be assembled, and the others with the reason."""
    there, left_out = [], []
    for each in some:
        try:
            # A loop may not close at an angle that the scene does not name.
            _ = comparison.reference.assembled.wiring(each), model.assembled.wiring(each)
            there.append(each)
        except CmsReduceError as error:
            left_out.append(f"{each.name}: {error}")
    return there, tuple(left_out)


def _even(count: int, most: int) -> list[int]:
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, most)).round()}) if count and most else []


def midpoint_configurations(scene: Scene) -> list[Configuration]:
    """Configurations midway between neighbouring ones of the scene that differ in one angle or parameter only.

    A configuration that differs from all others in several of them has none of these: it is joined to the ones before
    and after it in the list of the scene, as on a path.

    Parameters
    ----------
    scene : Scene
        Its configurations need not fill a grid.
    """
    found: dict[tuple[float, ...], Configuration] = {}
    axes = _axes(scene)
    sampled = [_place(each, axes) for each in scene.configurations]

    def add(middle: tuple[float, ...]) -> None:
        found.setdefault(middle, _at("midpoint", axes, middle))

    before, before_alone = None, False
    for here in sampled:
        alone = True
        for k, _ in enumerate(axes):
            others = [there[k] for there in sampled if there[:k] + there[k + 1 :] == here[:k] + here[k + 1 :]]
            beyond = [angle for angle in others if angle > here[k]]
            alone &= all(angle == here[k] for angle in others)
            if beyond:
                add((*here[:k], (here[k] + min(beyond)) / 2, *here[k + 1 :]))
        if before is not None and (alone or before_alone) and before != here:
            add(tuple((a + b) / 2 for a, b in zip(before, here, strict=True)))
        before, before_alone = here, alone
    return list(found.values())


def _beside(centre: Configuration, scene: Scene) -> list[Configuration]:
    """Configurations halfway between one and the nearest sampled values of each parameter, below and above it."""
    axes = _axes(scene)
    here = _place(centre, axes)
    sampled = [_place(each, axes) for each in scene.configurations]
    found = []
    for k, axis in enumerate(axes):
        if axis[1] != _PARAMETER:
            continue
        values = {there[k] for there in sampled}
        below, above = [v for v in values if v < here[k]], [v for v in values if v > here[k]]
        for other in (max(below, default=here[k]), min(above, default=here[k])):
            if other != here[k]:
                found.append(_at("beside", axes, (*here[:k], (here[k] + other) / 2, *here[k + 1 :])))
    return found


def _axes(scene: Scene) -> list[Axis]:
    """Joint motions and parameters that any configuration sets."""
    motions = sorted({axis for each in scene.configurations for axis in each.angles})
    names = sorted({name for each in scene.configurations for name in each.parameters})
    return [*motions, *((name, _PARAMETER) for name in names)]


def _place(configuration: Configuration, axes: Sequence[Axis]) -> tuple[float, ...]:
    return tuple(
        configuration.parameters.get(axis[0], 0.0) if axis[1] == _PARAMETER else configuration.angles.get(axis, 0.0)
        for axis in axes
    )


def _at(word: str, axes: Sequence[Axis], place: tuple[float, ...]) -> Configuration:
    pairs = list(zip(axes, place, strict=True))
    label = " ".join(_shown(axis, value) for axis, value in pairs)
    angles = {axis: value for axis, value in pairs if axis[1] != _PARAMETER}
    parameters = {axis[0]: value for axis, value in pairs if axis[1] == _PARAMETER}
    return Configuration(f"{word} {label}", angles, parameters, between=True)


def _shown(axis: Axis, value: float) -> str:
    name, dof = axis
    if dof == _PARAMETER:
        return parameter_label({name: value})
    size = f"{np.degrees(value):.4g}" if dof >= len(DOF_NAMES) // 2 else f"{value:.4g}"
    return f"{name}.{DOF_NAMES[dof]}={size}"
