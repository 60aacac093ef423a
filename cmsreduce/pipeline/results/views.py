"""Views of a run for pictures and the page: the drawing of its scene, effective masses, gains of the modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import place_bodies
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import (
    DOF_NAMES,
    BodyDrawing,
    Channel,
    Configuration,
    EffectiveMassCurve,
    FEModel,
    GainSum,
    JointDrawing,
    JointTerm,
    ModalComponent,
    Point,
    PointTerm,
    PortDrawing,
    RigidBody,
    SceneDrawing,
    SystemShapes,
    cross_matrix,
    rigid_body_shapes,
)
from cmsreduce.pipeline.bodies import cells_of, wireframe
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import diagnostic, once
from cmsreduce.pipeline.system import channel_gains
from cmsreduce.verify import effective_mass, held_modes
from cmsreduce.write import basic_shapes

__all__ = ["body_drawing", "body_effective_mass", "effective_mass_curves", "gain_curves", "scene_drawing"]

Array = NDArray[np.float64]


@diagnostic("the drawing of the scene")
def scene_drawing(run: Run) -> SceneDrawing | None:
    """Drawing of the scene of a run; None where no body has a geometry."""
    bodies: dict[str, BodyDrawing] = {}
    for name in run.reduced_names:
        drawn = body_drawing(run, name)
        if drawn is not None:
            bodies[name] = drawn
    for name, body in run.rigid_bodies.items():
        star = _rigid(body)
        if star is not None:
            bodies[name] = star
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


@once
@diagnostic("the drawing of '{}'", about=lambda run, name: name)
def body_drawing(run: Run, name: str) -> BodyDrawing | None:
    """Wireframe and shapes of a flexible body; None without geometry."""
    body = run.bodies[name].body
    found = wireframe(body, cells_of(body))
    if found is None or body.nodes is None:
        return None
    projected = run.projected is not None
    modes = run.final[name] if projected else run.ranked[name]
    e = modes.elastic
    kept = (
        np.arange(modes.omega.size) if projected else np.r_[: e.start, run.selection[name], e.stop : modes.omega.size]
    )
    shapes = basic_shapes(body, body.nodes, modes.Phi, found.node, "translation")
    # The coordinates of the system belong to the final modes, which may have another scale.
    kept = np.sort(kept).astype(np.int64)
    shapes[:, :, kept] = basic_shapes(body, body.nodes, run.final[name].Phi, found.node, "translation")
    # A node of unknown motion does not move in a picture.
    shapes = np.nan_to_num(shapes, nan=0.0)
    return BodyDrawing(name, found.xyz, found.lines, shapes, kept, True, found.meshed, found.left_out)


@diagnostic("the drawing of the rigid body '{}'", about=lambda body: body.name)
def _rigid(body: RigidBody) -> BodyDrawing | None:
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


def effective_mass_curves(run: Run) -> dict[str, EffectiveMassCurve]:
    """Running effective mass of every body with a geometry, with all its interfaces held."""
    curves = {name: body_effective_mass(run, name) for name in run.reduced_names}
    return {name: curve for name, curve in curves.items() if curve is not None}


@once
@diagnostic("the effective mass of '{}'", about=lambda run, name: name)
def body_effective_mass(run: Run, name: str) -> EffectiveMassCurve | None:
    """Running effective mass of one body; None without geometry or interfaces."""
    body = run.bodies[name].body
    if body.nodes is None or not body.interfaces:
        return None
    whole, kept = (_running(body, modes) for modes in (run.modal(name), run.final[name]))
    return None if whole is None or kept is None else EffectiveMassCurve(", ".join(body.interfaces), *whole, *kept)


@diagnostic("the gains of the modes", dict)
def gain_curves(run: Run) -> dict[str, tuple[GainSum, GainSum]]:
    """Modal gains of the modes kept and of all modes, by configuration; empty without channels or if too large."""
    if not run.has_response:
        return {}
    all_modes = run.untruncated.assembled
    found = {}
    for configuration in run.scene.configurations:
        kept, every = (channel_gains(model, configuration) for model in (run.model.assembled, all_modes))
        if kept is None or every is None:
            return {}
        found[configuration.name] = kept, every
    return found


def _running(body: FEModel, component: ModalComponent) -> tuple[Array, Array] | None:
    if body.nodes is None:
        return None
    try:
        held = np.unique(np.concatenate([body.interface_rows(face) for face in body.interfaces]))
    except CmsReduceError:
        return None
    modes = held_modes(component, held)
    if modes is None:
        return None
    hz, Q = modes
    point = np.vstack([face.position for face in body.interfaces.values()]).mean(axis=0)
    R = rigid_body_shapes(body.dofs, body.nodes, point)
    MR = np.asarray(body.M @ R)
    found = effective_mass(hz, (MR.T @ component.Phi) @ Q, R.T @ MR)
    return found.hz, found.running
