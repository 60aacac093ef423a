"""Motions and values of joints, and the channels of actuators and sensors, from the keys of a pipeline."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

import numpy as np

from cmsreduce.config.keys import ActuatorKeys, Pipeline, Quantity, SceneKeys, SensorKeys, parse_point, parse_row
from cmsreduce.errors import SceneError, not_among
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, Channel, JointTerm, PointTerm, StrutTerm, Units, dof_index

__all__ = [
    "actuator_channel",
    "free_dof",
    "free_dof_named",
    "sensor_channels",
    "joint_value",
    "sized_names",
]

_Quantity = Literal["translation", "rotation", "combination"]


def free_dof(scene: SceneKeys, joint: str, dof: str | None) -> int:
    """Free motion 0..5 of a joint; if no dof is named, the only free one.

    Raises
    ------
    SceneError
        If there is no such joint, the motion is locked, or several are free and none is named.
    """
    if joint not in scene.joints:
        raise SceneError(not_among("joint", joint, scene.joints))
    free = scene.joints[joint].free
    if not free:
        raise SceneError(f"joint '{joint}' is locked in all dofs: it has no motion; free one, e.g. `free: [rz]`")
    if dof is None:
        if len(free) > 1:
            raise SceneError(f"joint '{joint}' is free in {', '.join(free)}: name one, such as {joint}.{free[0]}")
        return DOF_NAMES.index(free[0])
    index = dof_index(dof)
    if DOF_NAMES[index] not in free:
        raise SceneError(
            f"joint '{joint}' is locked in {DOF_NAMES[index]}, it is free in {', '.join(free)}: "
            f"name one of these, or free this dof"
        )
    return index


def free_dof_named(scene: SceneKeys, key: str) -> tuple[str, int]:
    """Joint and free motion 0..5 that ``JOINT`` or ``JOINT.DOF`` names.

    Raises
    ------
    SceneError
        As `free_dof`.
    """
    joint, dot, dof = key.partition(".")
    return joint, free_dof(scene, joint, dof if dot else None)


def joint_value(dof: int, quantity: Quantity, units: Units) -> float:
    """Value of a joint motion in radians, or in the scene's unit of length.

    Raises
    ------
    UnitsError
        If an angle has no unit, or the unit is of another dimension.
    """
    return quantity.to_si("angle") if dof >= FIRST_ROTATION else quantity.length_in(units)


def actuator_channel(pipeline: Pipeline, name: str, actuator: ActuatorKeys) -> Channel:
    """Input channel of an actuator.

    Raises
    ------
    SceneError
        If its joint is unknown, or locked in the named motion.
    """
    if actuator.at is None:
        return _shared_form(pipeline, name, actuator, rate=False)
    vector = np.zeros(6)
    quantity: _Quantity
    if actuator.force is not None:
        vector[:FIRST_ROTATION], quantity = actuator.force, "translation"
    else:
        vector[FIRST_ROTATION:], quantity = actuator.torque, "rotation"
    return Channel(name, (PointTerm(parse_point(actuator.at), vector),), quantity)


def sensor_channels(pipeline: Pipeline, name: str, sensor: SensorKeys) -> Iterator[Channel]:
    """Output channels of a sensor, one for each measured motion.

    Raises
    ------
    SceneError
        If its joint is unknown, or locked in the named motion.
    """
    if sensor.at is None:
        yield _shared_form(pipeline, name, sensor, sensor.rate)
        return
    point, motions = parse_point(sensor.at), sensor.measure or ()
    for motion in motions:
        index = dof_index(motion)
        label = name if len(motions) == 1 else f"{name}.{motion}"
        yield Channel(label, (PointTerm(point, np.eye(6)[index]),), _kind({index}), sensor.rate)


def sized_names(pipeline: Pipeline) -> tuple[dict[str, list[Channel]], dict[str, list[Channel]]]:
    """Inputs and outputs of the scene by the names for which the user can state a size.

    An actuator has one channel. A sensor of several motions has several; each of them also has its own name.

    Raises
    ------
    SceneError
        If the joint of a channel is unknown, or locked in the named motion.
    """
    keys = pipeline.scene
    inputs = {name: [actuator_channel(pipeline, name, actuator)] for name, actuator in keys.actuators.items()}
    outputs = {name: list(sensor_channels(pipeline, name, sensor)) for name, sensor in keys.sensors.items()}
    return inputs, {**{c.name: [c] for channels in outputs.values() for c in channels}, **outputs}


def _shared_form(pipeline: Pipeline, name: str, keys: ActuatorKeys | SensorKeys, rate: bool) -> Channel:
    """Channel on a joint, between two points, or of rows, for actuators and sensors alike."""
    if keys.joint is not None:
        dof = free_dof(pipeline.scene, keys.joint, keys.dof)
        return Channel(name, (JointTerm(keys.joint, dof),), _kind({dof}), rate)
    if keys.between is not None:
        a, b = (parse_point(text) for text in keys.between)
        return Channel(name, (StrutTerm(a, b),), "translation", rate)
    rows = [(*parse_row(row), weight) for row, weight in (keys.rows or {}).items()]
    terms = tuple(PointTerm(point, np.where(np.arange(6) == dof, weight, 0.0)) for point, dof, weight in rows)
    return Channel(name, terms, _kind({dof for _, dof, _ in rows}), rate)


def _kind(dofs: set[int]) -> _Quantity:
    if min(dofs) >= FIRST_ROTATION:
        return "rotation"
    return "combination" if max(dofs) >= FIRST_ROTATION else "translation"
