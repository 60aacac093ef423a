"""References from one part of a pipeline to another, which no key can check by itself."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from cmsreduce.config.keys import (
    CLOSED_LOOP,
    FLEXIBLE_ONLY,
    MOMENTUM,
    ActuatorKeys,
    Articulation,
    Component,
    Compound,
    KeepKeys,
    Pipeline,
    Quantity,
    RankingKeys,
    ScalingKeys,
    SensorKeys,
    channel_kind,
    figure_powers,
    parse_point,
    parse_row,
    parse_value,
    powers_of,
)
from cmsreduce.config.scene_channels import free_dof, free_dof_named, joint_value, sized_names
from cmsreduce.errors import SceneError, UnitsError, not_among
from cmsreduce.model import DOF_NAMES, Point, UnitLoad

__all__ = ["BrokenReference", "broken_references"]


_FIRST_ROTATION = 3


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


def broken_references(pipeline: Pipeline) -> Iterator[BrokenReference]:
    """Broken references of a pipeline, in the order of the grammar."""
    yield from _components(pipeline)
    yield from _joints(pipeline)
    scene = pipeline.scene
    if scene.articulation is not None:
        yield from _articulation(pipeline, scene.articulation)
    yield from _parameters(pipeline)
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


def _articulation(pipeline: Pipeline, articulation: Articulation) -> Iterator[BrokenReference]:
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


def _parameters(pipeline: Pipeline) -> Iterator[BrokenReference]:
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
            wanted = figure_powers(figure, dof >= _FIRST_ROTATION)
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
