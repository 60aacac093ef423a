"""The scene as the stages take it, built from the keys of a pipeline."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

from cmsreduce.config.keys import Pipeline, Quantity, parse_point
from cmsreduce.config.references import broken_references
from cmsreduce.config.scene_channels import actuator_channel, free_dof_named, joint_value, sensor_channels
from cmsreduce.errors import SceneError
from cmsreduce.model import Configuration, Joint, Scene, dof_index

__all__ = ["build_scene"]

_FIRST_ROTATION = 3


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
    return Scene(
        bodies=tuple(pipeline.components),
        band=keys.band,
        joints=tuple(_joints(pipeline)),
        configurations=tuple(_configurations(pipeline)),
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
            x, y, z = (item.length_in(pipeline.units) for item in joint.offset)
            offset = (x, y, z)
        free = frozenset(dof_index(dof) for dof in joint.free)
        yield Joint(name, first, second, free, offset, joint.elements(pipeline.units))


def _configurations(pipeline: Pipeline) -> Iterator[Configuration]:
    """All combinations of joint values, the last joint varying fastest, or the named configurations."""
    articulation = pipeline.scene.articulation
    if articulation is None or not (articulation.product or articulation.named):
        yield Configuration("as built")
        return
    if articulation.named is not None:
        for named in articulation.named:
            yield _configuration(pipeline, named.joints, named.name)
        return
    joints = articulation.product or {}
    for values in product(*(listed.quantities() for listed in joints.values())):
        yield _configuration(pipeline, dict(zip(joints, values, strict=True)), None)


def _configuration(pipeline: Pipeline, values: dict[str, Quantity], name: str | None) -> Configuration:
    angles: dict[tuple[str, int], float] = {}
    labels: list[str] = []
    for key, quantity in values.items():
        joint, dof = free_dof_named(pipeline.scene, key)
        value = joint_value(dof, quantity, pipeline.units)
        angles[joint, dof] = value
        # Adding zero turns -0 into 0. Six digits hide the round-off of the conversion to degrees.
        labels.append(f"{key}={(math.degrees(value) if dof >= _FIRST_ROTATION else value) + 0.0:.6g}")
    return Configuration(name or " ".join(labels) or "as built", angles)
