"""The scene as the stages take it, built from the keys of a pipeline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from cmsreduce.config.keys import Pipeline, Quantity, parse_point, parse_value, place_in
from cmsreduce.config.references import broken_references
from cmsreduce.config.scene_channels import actuator_channel, free_dof_named, joint_value, sensor_channels
from cmsreduce.errors import SceneError
from cmsreduce.model import (
    FIRST_ROTATION,
    Configuration,
    Joint,
    JointElement,
    Scene,
    Values,
    dof_index,
    parameter_label,
)

__all__ = ["build_scene"]


def build_scene(pipeline: Pipeline) -> Scene:
    """Joints, configurations, channels and placements of a pipeline.

    Parameters
    ----------
    pipeline : Pipeline
        Checked keys.

    Returns
    -------
    Scene
        Frequencies in Hz, angles in rad, lengths in the scene's unit; the base is named.

    Raises
    ------
    SceneError
        If a part of the pipeline refers to another that does not exist.
    """
    wrong = [f"{'.'.join(map(str, broken.keys))}: {broken.message}" for broken in broken_references(pipeline)]
    if wrong:
        raise SceneError("\n".join(wrong))
    keys, units = pipeline.scene, pipeline.units
    configurations = tuple(_configurations(pipeline))
    names = [each.name for each in configurations]
    if repeated := [name for k, name in enumerate(names) if name in names[:k]]:
        raise SceneError(
            f"two configurations are named '{repeated[0]}': their values agree in six digits; take values further apart"
        )
    return Scene(
        bodies=tuple(pipeline.components),
        band=keys.band,
        joints=tuple(_joints(pipeline)),
        configurations=configurations,
        actuators=tuple(actuator_channel(pipeline, name, actuator) for name, actuator in keys.actuators.items()),
        sensors=tuple(
            channel for name, sensor in keys.sensors.items() for channel in sensor_channels(pipeline, name, sensor)
        ),
        base=keys.base or next(iter(pipeline.components)),
        ground=tuple(parse_point(text) for text in keys.ground),
        floating=keys.floating,
        redundant=keys.redundant,
        placements={
            name: component.place.placement(units)
            for name, component in pipeline.components.items()
            if component.place is not None
        },
        units=units,
    )


def _joints(pipeline: Pipeline) -> Iterator[Joint]:
    for name, joint in pipeline.scene.joints.items():
        first, second = (parse_point(text) for text in joint.connect)
        offset = None
        if joint.offset is not None:
            x, y, z = place_in(joint.offset, pipeline.units).tolist()
            offset = (x, y, z)
        free = frozenset(dof_index(dof) for dof in joint.free)
        yield Joint(name, first, second, free, offset, _elements(pipeline, name))


def _elements(pipeline: Pipeline, joint: str) -> tuple[JointElement, ...]:
    """Springs, dampers and inertias of a joint, those that parameters give it included."""
    found = {each.dof: each for each in pipeline.scene.joints[joint].elements(pipeline.units)}
    for parameter, keys in pipeline.scene.parameters.items():
        for key, figure in keys.joints.items():
            name, dof = free_dof_named(pipeline.scene, key)
            if name == joint:
                known = found.get(dof, JointElement(dof))
                found[dof] = replace(known, varied=(*known.varied, (parameter, figure)))
    return tuple(found[dof] for dof in sorted(found))


def _configurations(pipeline: Pipeline) -> Iterator[Configuration]:
    """All combinations of joint values, or the named configurations, with all combinations of parameters.

    The last joint varies fastest, and parameters faster than joints. A parameter that a named configuration sets has
    that value there.
    """
    varied = {name: keys.values for name, keys in pipeline.scene.parameters.items()}
    for configuration in _articulated(pipeline):
        own = {name: values for name, values in varied.items() if values and name not in configuration.parameters}
        for values in product(*own.values()):
            numbers = {name: value.number_in(pipeline.units) for name, value in zip(own, values, strict=True)}
            if not numbers:
                yield configuration
                continue
            base = "" if configuration.name == "as built" and not configuration.angles else f"{configuration.name} "
            parameters = {**configuration.parameters, **numbers}
            yield Configuration(f"{base}{parameter_label(numbers)}", configuration.angles, parameters)


def _articulated(pipeline: Pipeline) -> Iterator[Configuration]:
    articulation = pipeline.scene.articulation
    if articulation is None or not (articulation.product or articulation.named):
        yield Configuration("as built")
        return
    if articulation.named is not None:
        for named in articulation.named:
            angles: dict[str, Quantity] = {}
            parameters: dict[str, float] = {}
            for key, value in named.joints.items():
                if key in pipeline.scene.parameters:
                    parameters[key] = parse_value(value.plain).number_in(pipeline.units)
                else:
                    assert isinstance(value, Quantity)
                    angles[key] = value
            yield _configuration(pipeline, angles, named.name, parameters)
        return
    joints = articulation.product or {}
    for values in product(*(listed.quantities() for listed in joints.values())):
        yield _configuration(pipeline, dict(zip(joints, values, strict=True)), None)


def _configuration(
    pipeline: Pipeline, values: dict[str, Quantity], name: str | None, parameters: Values | None = None
) -> Configuration:
    angles: dict[tuple[str, int], float] = {}
    labels: list[str] = []
    for key, quantity in values.items():
        joint, dof = free_dof_named(pipeline.scene, key)
        value = joint_value(dof, quantity, pipeline.units)
        angles[joint, dof] = value
        # Adding zero turns -0 into 0. Six digits hide the round-off of the conversion to degrees.
        labels.append(f"{key}={(math.degrees(value) if dof >= FIRST_ROTATION else value) + 0.0:.6g}")
    if parameters:
        labels.append(parameter_label(parameters))
    return Configuration(name or " ".join(labels) or "as built", angles, parameters or {})
