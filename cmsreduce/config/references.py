"""References from one part of a pipeline to another, which no key can check by itself."""

from __future__ import annotations

from collections.abc import Iterator

from cmsreduce.config.configuration_references import BrokenReference, articulation_references, parameter_references
from cmsreduce.config.keys import (
    CLOSED_LOOP,
    FLEXIBLE_ONLY,
    ActuatorKeys,
    Component,
    KeepKeys,
    Pipeline,
    RankingKeys,
    ScalingKeys,
    SensorKeys,
    channel_kind,
    parse_point,
    parse_row,
)
from cmsreduce.config.scene_channels import free_dof, sized_names
from cmsreduce.errors import SceneError, UnitsError, not_among
from cmsreduce.model import Point, UnitLoad

__all__ = ["broken_references"]


def broken_references(pipeline: Pipeline) -> Iterator[BrokenReference]:
    """Broken references of a pipeline, in the order of the grammar."""
    yield from _components(pipeline)
    yield from _joints(pipeline)
    scene = pipeline.scene
    if scene.articulation is not None:
        yield from articulation_references(pipeline, scene.articulation)
    yield from parameter_references(pipeline)
    channels: tuple[tuple[str, dict[str, ActuatorKeys] | dict[str, SensorKeys]], ...] = (
        ("actuators", scene.actuators),
        ("sensors", scene.sensors),
    )
    for kind, group in channels:
        for name, channel in group.items():
            yield from _channel(pipeline, ("scene", kind, name), channel)
    if scene.controller is not None and not (scene.sensors and scene.actuators):
        yield BrokenReference(
            ("scene", "controller"), "a controller needs sensors and actuators: add them, or take it out"
        )
    for k, text in enumerate(scene.ground):
        yield from _interface(pipeline, ("scene", "ground", k), text)
    for k, name in enumerate(scene.floating):
        if name not in pipeline.components:
            yield BrokenReference(("scene", "floating", k), not_among("component", name, pipeline.components))
    if scene.base is not None and scene.base not in pipeline.components:
        yield BrokenReference(("scene", "base"), not_among("component", scene.base, pipeline.components))
    yield from _stiffening(pipeline)
    yield from _residuals(pipeline)
    yield from _frames(pipeline)
    for at, ranking in _rankings(pipeline):
        if at[0] != "components":
            yield from _keep(pipeline, (*at, "keep"), ranking.keep)
        yield from _sizes(pipeline, (*at, "scaling"), ranking.scaling)
        if ranking.rank == CLOSED_LOOP:
            yield from _controlled(pipeline, (*at, "rank"))


def _stiffening(pipeline: Pipeline) -> Iterator[BrokenReference]:
    """Check interfaces that geometric stiffness names, and bodies that the scene spins."""
    for name, component in pipeline.components.items():
        keys, at = component.geometric_stiffness, ("components", name, "geometric_stiffness")
        if keys is None:
            continue
        points: list[tuple[tuple[str, ...], str]] = [(("bars",), load.at) for load in keys.computed()]
        points += [(("matrices", label, "load"), UnitLoad.parse(item.load).at) for label, item in keys.matrices.items()]
        points += [(("held",), face) for face in keys.held]
        for key, point in dict.fromkeys(points):
            if point and not (point.isdigit() and key != ("held",)) and point not in component.interfaces:
                yield BrokenReference((*at, *key), not_among("interface", point, component.interfaces))
        if keys.bars and component.geometry is None:
            yield BrokenReference((*at, "bars"), "bars are read from the deck: give the component its `geometry:`")
    flexible = [name for name, component in pipeline.components.items() if component.rigid is None]
    for name in pipeline.scene.spin:
        if name not in flexible:
            yield BrokenReference(("scene", "spin", name), not_among("flexible component", name, flexible))


def _wheels(name: str, component: Component) -> Iterator[BrokenReference]:
    """Check the places of wheels."""
    for wheel, keys in component.wheels.items():
        at = ("components", name, "wheels", wheel)
        if component.rigid is not None and keys.at is not None:
            yield BrokenReference((*at, "at"), "a wheel turns a rigid body as one, wherever it is: take this key out")
        elif component.rigid is None and keys.at is None:
            yield BrokenReference(at, "a wheel in a flexible body needs its node or interface: `at: 1001`")
        elif isinstance(keys.at, str) and keys.at not in component.interfaces:
            yield BrokenReference((*at, "at"), not_among("interface", keys.at, component.interfaces))


def _residuals(pipeline: Pipeline) -> Iterator[BrokenReference]:
    if pipeline.reduce is None:
        return
    for text in pipeline.reduce.own_points:
        yield BrokenReference(
            ("reduce", "residuals"),
            f"'{text}' is a node of one body: write it under components.NAME.reduce.residuals; only `sensors`, "
            "`actuators` and `dampers` are valid for all bodies",
        )


def _components(pipeline: Pipeline) -> Iterator[BrokenReference]:
    for name, component in pipeline.components.items():
        for key in FLEXIBLE_ONLY if component.rigid is not None else ():
            if getattr(component, key) not in (None, False):
                yield BrokenReference(
                    ("components", name, key), f"a rigid body has no {key}: take out this key, or 'rigid'"
                )
        yield from _wheels(name, component)
        for face, keys in component.interfaces.items():
            at = ("components", name, "interfaces", face)
            if component.rigid is not None and (keys.position is None or keys.tie is not None):
                yield BrokenReference(
                    at, "an interface of a rigid body is given by its position, e.g. {position: [0, 0, 0]}"
                )
            if component.rigid is None and keys.position is not None and keys.tie is None:
                yield BrokenReference(
                    at, "an interface of a flexible body is given by node, nodes, set or near, e.g. {node: 1001}"
                )
        if component.balance is not None:
            at = ("components", name, "balance", "keep")
            if component.balance.keep.frf_error is not None:
                yield BrokenReference(at, "frf_error is an error of the whole system: ask for it under 'balance.keep'")
            if isinstance(component.balance.keep.modes, dict):
                yield BrokenReference(at, "here is one body only: write a number, e.g. {modes: 20}")


def _frames(pipeline: Pipeline) -> Iterator[BrokenReference]:
    """Check interfaces that frames and integrals name."""
    for name, component in pipeline.components.items():
        if component.rigid is not None or pipeline.reduce_of(name) is None:
            continue
        keys, own = pipeline.write_of(name), component.write
        named = [(("integrals", key), face) for key, face in keys.integrals.interfaces.items()]
        named += [(("frame", key), face) for key, face in (keys.frame.interfaces if keys.frame else {}).items()]
        for (group, key), face in named:
            if face in component.interfaces:
                continue
            message = f"component '{name}': {not_among('interface', face, component.interfaces)}"
            if own is not None and group in own.model_fields_set:
                yield BrokenReference(("components", name, "write", group, key), message)
            else:
                message += f"; give this body its own keys, components.{name}.write"
                yield BrokenReference(("write", group, key), message)


def _joints(pipeline: Pipeline) -> Iterator[BrokenReference]:
    for name, joint in pipeline.scene.joints.items():
        for k, text in enumerate(joint.connect):
            yield from _interface(pipeline, ("scene", "joints", name, "connect", k), text)


def _interface(pipeline: Pipeline, keys: tuple[str | int, ...], text: str) -> Iterator[BrokenReference]:
    """Check a reference to an interface."""
    point = parse_point(text)
    if point.body not in pipeline.components:
        yield BrokenReference(keys, not_among("component", point.body, pipeline.components))
        return
    component = pipeline.components[point.body]
    if point.name in component.interfaces:
        return
    message = f"component '{point.body}': {not_among('interface', point.name, component.interfaces)}"
    if point.name.isdigit() and component.rigid is None:
        message += f"; declare the node under 'components.{point.body}.interfaces', e.g. NAME: {{node: {point.name}}}"
    yield BrokenReference(keys, message)


def _point(pipeline: Pipeline, keys: tuple[str | int, ...], point: Point) -> Iterator[BrokenReference]:
    """Check a reference to an interface, a node, or the centre of mass."""
    component = pipeline.components.get(point.body)
    if component is None:
        yield BrokenReference(keys, not_among("component", point.body, pipeline.components))
    elif point.name == "cg":
        if component.rigid is None:
            yield BrokenReference(keys, f"'{point}': the centre of mass is not a point of a flexible body; name a node")
    elif point.name.isdigit():
        if component.rigid is not None:
            places = ", ".join(["cg", *component.interfaces])
            yield BrokenReference(keys, f"'{point}': a rigid body has no nodes; points of '{point.body}' are {places}")
    elif point.name not in component.interfaces:
        message = f"component '{point.body}': {not_among('interface', point.name, component.interfaces)}"
        yield BrokenReference(keys, f"{message}; a node is named by its number")


def _channel(
    pipeline: Pipeline, keys: tuple[str | int, ...], channel: ActuatorKeys | SensorKeys
) -> Iterator[BrokenReference]:
    if channel.at is not None:
        yield from _point(pipeline, (*keys, "at"), parse_point(channel.at))
    for k, text in enumerate(channel.between or ()):
        yield from _point(pipeline, (*keys, "between", k), parse_point(text))
    for row in channel.rows or {}:
        yield from _point(pipeline, (*keys, "rows", row), parse_row(row)[0])
    if channel.joint is not None:
        try:
            free_dof(pipeline.scene, channel.joint, channel.dof)
        except SceneError as error:
            known = channel.joint in pipeline.scene.joints and channel.dof is not None
            yield BrokenReference((*keys, "dof" if known else "joint"), str(error))


def _keep(pipeline: Pipeline, keys: tuple[str | int, ...], keep: KeepKeys) -> Iterator[BrokenReference]:
    flexible = [name for name, component in pipeline.components.items() if component.rigid is None]
    for name in keep.modes if isinstance(keep.modes, dict) else ():
        if name not in flexible:
            yield BrokenReference((*keys, "modes", name), not_among("flexible component", name, flexible))
    for name in keep.numbers or ():
        if name not in flexible:
            yield BrokenReference((*keys, name), not_among("flexible component", name, flexible))
    stated = {} if pipeline.verify is None else pipeline.verify.limits.model_dump(exclude_none=True)
    if keep.rule == "limits" and not stated and pipeline.scene.controller is None:
        yield BrokenReference(
            keys, "`limits` keeps the smallest model that meets verify.limits: state one there, e.g. {frf_error: 0.05}"
        )


def _controlled(pipeline: Pipeline, keys: tuple[str | int, ...]) -> Iterator[BrokenReference]:
    if pipeline.scene.controller is None:
        yield BrokenReference(
            keys, f"{CLOSED_LOOP} weighs modes by the loop of a controller: name one in scene.controller"
        )
    elif pipeline.balance is not None and pipeline.balance.sensitivity:
        yield BrokenReference(
            keys, f"{CLOSED_LOOP} has no figure without a sensor of its controller: take balance.sensitivity out"
        )


def _rankings(pipeline: Pipeline) -> Iterator[tuple[tuple[str, ...], RankingKeys]]:
    """Every ranking of a pipeline, and where it is written."""
    if pipeline.balance is not None:
        yield ("balance",), pipeline.balance
    for name, component in pipeline.components.items():
        if component.balance is not None:
            yield ("components", name, "balance"), component.balance
    for label, ranking in (pipeline.verify.compare if pipeline.verify is not None else {}).items():
        yield ("verify", "compare", label), ranking


def _sizes(pipeline: Pipeline, keys: tuple[str | int, ...], scaling: ScalingKeys) -> Iterator[BrokenReference]:
    try:
        inputs, outputs = sized_names(pipeline)
    except SceneError:
        # The broken channel is reported by itself.
        return
    for kind, sizes, channels in (("inputs", scaling.inputs, inputs), ("outputs", scaling.outputs, outputs)):
        what = "actuator" if kind == "inputs" else "sensor"
        for name, size in sizes.items():
            if name not in channels:
                yield BrokenReference((*keys, kind, name), not_among(what, name, channels))
                continue
            try:
                for channel in channels[name]:
                    size.value_in(pipeline.units, channel_kind(channel, effort=kind == "inputs"))
            except UnitsError as error:
                yield BrokenReference((*keys, kind, name), str(error))
