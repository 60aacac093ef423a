"""References in the configurations of a scene: values of joints, and parameters beside them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cmsreduce.config.keys import (
    MOMENTUM,
    Articulation,
    Compound,
    Pipeline,
    Quantity,
    figure_powers,
    parse_value,
    powers_of,
)
from cmsreduce.config.scene_channels import free_dof_named, joint_value
from cmsreduce.errors import SceneError, UnitsError, not_among
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION

__all__ = ["BrokenReference", "articulation_references", "parameter_references"]


class BrokenReference(NamedTuple):
    """A reference to something that does not exist or does not fit.

    Parameters
    ----------
    keys : tuple of str or int
        Place of the reference in the pipeline file.
    message : str
        Fault in words.
    """

    keys: tuple[str | int, ...]
    message: str


def articulation_references(pipeline: Pipeline, articulation: Articulation) -> Iterator[BrokenReference]:
    """Check joints, values and names of the configurations."""
    at = ("scene", "articulation")
    for joint, values in (articulation.product or {}).items():
        quantities = values.quantities()
        yield from _joint_values(pipeline, (*at, joint), joint, quantities)
        repeated = [item for k, item in enumerate(quantities) if item in quantities[:k]]
        if repeated:
            yield BrokenReference((*at, joint), f"{repeated[0]} is listed twice")
    for joint, others in _same_motion(pipeline, list(articulation.product or {})):
        yield BrokenReference((*at, joint), f"the same motion is set by '{others}'")
    names: list[str | None] = []
    for k, named in enumerate(articulation.named or ()):
        joints = {key: value for key, value in named.joints.items() if key not in pipeline.scene.parameters}
        for joint, quantity in joints.items():
            if not isinstance(quantity, Quantity):
                yield BrokenReference((*at, k, joint), f"{quantity} is no value of a joint, e.g. 45 deg")
                continue
            yield from _joint_values(pipeline, (*at, k, joint), joint, (quantity,))
        for key in named.joints.keys() - joints.keys():
            yield from _named_value(pipeline, (*at, k, key), key, named.joints[key])
        for joint, others in _same_motion(pipeline, list(joints)):
            yield BrokenReference((*at, k, joint), f"the same motion is set by '{others}'")
        if named.name is not None and named.name in names:
            yield BrokenReference((*at, k, "name"), f"two configurations are named '{named.name}'")
        names.append(named.name)


def parameter_references(pipeline: Pipeline) -> Iterator[BrokenReference]:
    """Check components and joints that parameters name, and that every parameter has values."""
    scene = pipeline.scene
    flexible = [
        name
        for name, part in pipeline.components.items()
        if part.rigid is None and part.reduced is None and part.modes is None
    ]
    wheels = [f"{name}.{wheel}" for name, part in pipeline.components.items() for wheel in part.wheels]
    listed = scene.articulation.named if scene.articulation is not None else None
    for name, keys in scene.parameters.items():
        at = ("scene", "parameters", name)
        if name in scene.joints or any(name == f"{joint}.{dof}" for joint in scene.joints for dof in DOF_NAMES):
            yield BrokenReference(at, "a joint has this name; choose another one for the parameter")
        for what in ("stiffness", "mass", "damping", "gyroscopic"):
            for body in getattr(keys, what):
                if body not in flexible:
                    yield BrokenReference((*at, what, body), not_among("component with matrices", body, flexible))
        for text in keys.wheels:
            if text not in wheels:
                yield BrokenReference((*at, "wheels"), not_among("wheel", text, wheels))
        for value in keys.values if keys.wheels else ():
            if value.unit and powers_of(value) != MOMENTUM:
                yield BrokenReference((*at, "values"), f"{value} is no angular momentum, e.g. 12 N*m*s")
        for key, figure in keys.joints.items():
            try:
                _, dof = free_dof_named(scene, key)
            except SceneError as error:
                yield BrokenReference((*at, "joints", key), str(error))
                continue
            wanted = figure_powers(figure, dof >= FIRST_ROTATION)
            if wanted is None:
                yield BrokenReference(
                    (*at, "joints", key), "a sliding joint has no inertia: add the mass to a body by `mass`"
                )
            for value in keys.values:
                if value.unit and wanted is not None and powers_of(value) != wanted:
                    yield BrokenReference((*at, "values"), f"{value} is no {figure} of '{key}'")
                if value.value < 0:
                    yield BrokenReference((*at, "values"), f"{value}: a {figure} of a joint is negative")
        if not keys.values and not (listed and all(name in one.joints for one in listed)):
            yield BrokenReference(
                at, "it has no `values`, and not every configuration of the list under `articulation` states one"
            )


def _named_value(
    pipeline: Pipeline, keys: tuple[str | int, ...], name: str, value: Quantity | Compound
) -> Iterator[BrokenReference]:
    """Check the value of a parameter in a list of configurations."""
    try:
        own = parse_value(value.plain)
    except UnitsError as error:
        yield BrokenReference(keys, str(error))
        return
    known = [each for each in pipeline.scene.parameters[name].values if each.unit]
    if own.unit and known and powers_of(own) != powers_of(known[0]):
        yield BrokenReference(keys, f"{own} and {known[0]} are of different dimensions")


def _same_motion(pipeline: Pipeline, joints: list[str]) -> Iterator[tuple[str, str]]:
    """Pairs of keys that name the same motion, once as JOINT and once as JOINT.DOF."""
    seen: dict[tuple[str, int], str] = {}
    for key in joints:
        try:
            motion = free_dof_named(pipeline.scene, key)
        except SceneError:
            continue
        if motion in seen:
            yield key, seen[motion]
        seen[motion] = key


def _joint_values(
    pipeline: Pipeline, keys: tuple[str | int, ...], joint: str, quantities: tuple[Quantity, ...]
) -> Iterator[BrokenReference]:
    try:
        _, dof = free_dof_named(pipeline.scene, joint)
        # The largest first: a zero needs no unit, so it would hide a wrong one.
        for quantity in sorted(quantities, key=lambda item: -abs(item.value)):
            joint_value(dof, quantity, pipeline.units)
    except (SceneError, UnitsError) as error:
        yield BrokenReference(keys, str(error))
