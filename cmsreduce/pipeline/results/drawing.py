"""What the scene of a run looks like, and how the modes of its reduced system move it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import place_bodies
from cmsreduce.model import (
    DOF_NAMES,
    BodyDrawing,
    Channel,
    Configuration,
    JointDrawing,
    JointTerm,
    Point,
    PointTerm,
    PortDrawing,
    RigidBody,
    SceneDrawing,
    SystemShapes,
    cross_matrix,
)
from cmsreduce.pipeline.bodies import cells_of, outline
from cmsreduce.pipeline.run import Run
from cmsreduce.write import basic_shapes

__all__ = ["scene_drawing"]


def scene_drawing(run: Run) -> SceneDrawing | None:
    """Draw the scene of a run; None where no body has a geometry.

    Parameters
    ----------
    run : Run
        Its reduced system is assembled, if that is not done yet.
    """
    bodies: dict[str, BodyDrawing] = {}
    for name in run.reduced_names:
        drawn = _flexible(run, name)
        if drawn is not None:
            bodies[name] = drawn
    for name, body in run.rigid_bodies.items():
        bodies[name] = _rigid(body)
    if not any(body.flexible for body in bodies.values()):
        return None
    joints = _joints(run, bodies)
    return SceneDrawing(
        bodies=bodies,
        joints=joints,
        ports=_ports(run, bodies, joints),
        systems={each.name: _system(run, each, bodies) for each in run.scene.configurations},
        length=run.scene.units.name,
    )


def _flexible(run: Run, name: str) -> BodyDrawing | None:
    body = run.bodies[name].body
    found = outline(body, cells_of(body))
    if found is None or body.nodes is None:
        return None
    projected = run.projected is not None
    modes = run.final[name] if projected else run.ranked[name]
    e = modes.elastic
    kept = (
        np.arange(modes.omega.size) if projected else np.r_[: e.start, run.selection[name], e.stop : modes.omega.size]
    )
    shapes = basic_shapes(body, body.nodes, modes.Phi, found.node, "translation")
    # The coordinates of the system are those of the final modes, which may be scaled otherwise.
    kept = np.sort(kept).astype(np.int64)
    shapes[:, :, kept] = basic_shapes(body, body.nodes, run.final[name].Phi, found.node, "translation")
    # A node whose motion is not known stands still in a picture.
    shapes = np.nan_to_num(shapes, nan=0.0)
    return BodyDrawing(name, found.xyz, found.lines, shapes, kept, True, found.meshed, found.left_out)


def _rigid(body: RigidBody) -> BodyDrawing:
    """A star from the centre of mass to the interfaces."""
    ends = [np.atleast_2d(face.position).mean(axis=0) for face in body.interfaces.values()]
    xyz = np.vstack([body.cg, *ends])
    lines = np.array([[0, k] for k in range(1, len(xyz))], dtype=np.int64).reshape(-1, 2)
    # Coordinates of a rigid body are its motions at the centre of mass.
    turned = -cross_matrix(xyz - body.cg)
    shapes = np.concatenate([np.tile(np.eye(3), (len(xyz), 1, 1)), turned], axis=2)
    return BodyDrawing(body.name, xyz, lines, shapes, np.arange(6), flexible=False)


def _joints(run: Run, bodies: dict[str, BodyDrawing]) -> tuple[JointDrawing, ...]:
    found = []
    subs = run.model.assembled.substructures
    for joint in run.scene.joints:
        first = joint.first
        if first.body not in bodies or joint.second.body not in bodies:
            continue
        face = subs[first.body].interfaces[first.name]
        free = sorted(joint.free)
        axes = np.array([face.frame[dof % 3] for dof in free]).reshape(-1, 3)
        arm = np.asarray(joint.offset if joint.offset is not None else (0.0, 0.0, 0.0))
        position = np.atleast_2d(face.position).mean(axis=0) + arm
        names = tuple(DOF_NAMES[dof] for dof in free)
        found.append(JointDrawing(joint.name, (first.body, joint.second.body), position, axes, names))
    return tuple(found)


def _ports(run: Run, bodies: dict[str, BodyDrawing], joints: tuple[JointDrawing, ...]) -> tuple[PortDrawing, ...]:
    found = []
    at_joint = {joint.name: joint for joint in joints}
    for kind, channels in (("actuator", run.scene.actuators), ("sensor", run.scene.sensors)):
        for channel in channels:
            for body, position in _places(run, channel, at_joint):
                if body in bodies:
                    found.append(PortDrawing(channel.name, kind, body, position))
    return tuple(found)


def _places(run: Run, channel: Channel, joints: dict[str, JointDrawing]) -> list[tuple[str, NDArray[np.float64]]]:
    places = []
    for term in channel.terms:
        if isinstance(term, JointTerm):
            if term.joint in joints:
                places.append((joints[term.joint].bodies[0], joints[term.joint].position))
            continue
        points = (term.at,) if isinstance(term, PointTerm) else (term.a, term.b)
        places += [(point.body, place) for point in points if (place := _position(run, point)) is not None]
    return places


def _position(run: Run, point: Point) -> NDArray[np.float64] | None:
    sub = run.model.assembled.substructures[point.body]
    if point.name in sub.interfaces:
        return np.asarray(np.atleast_2d(sub.interfaces[point.name].position).mean(axis=0))
    return None if point.name not in sub.position else np.asarray(sub.position[point.name])


def _system(run: Run, configuration: Configuration, bodies: dict[str, BodyDrawing]) -> SystemShapes:
    model = run.model.assembled
    found = model.resonances(configuration)
    placed = place_bodies(model.substructures, run.scene, configuration)
    return SystemShapes(
        hz=found.omega / (2 * np.pi),
        zeta=found.zeta,
        amplitudes={name: np.asarray(found.shapes[name]) for name in bodies},
        placements={name: placed[name] for name in bodies},
    )
