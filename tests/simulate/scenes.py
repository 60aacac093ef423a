"""Scenes of small bodies for simulation: bodies through their component files, hinges between their interfaces."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.mechanics import floating_frame, modal_integrals
from cmsreduce.model import (
    Channel,
    Configuration,
    FrameCondition,
    IntegralFrame,
    Interface,
    Joint,
    JointTerm,
    ModalComponent,
    MultibodyScene,
    Placement,
    Point,
    RigidBody,
    Scene,
    SceneBody,
    SceneJoint,
)
from cmsreduce.pipeline.results import floating_body
from cmsreduce.simulate import Motion, simulate_scene
from cmsreduce.write import write_component

__all__ = ["hinged", "joint", "rigid_part", "simulate", "written"]

PART: dict[str, Any] = {"nodes": (), "inputs": {}, "outputs": {}, "checks": (), "provenance": {}, "all_nodes": True}
RZ = 5


def written(folder: Path, component: ModalComponent, condition: FrameCondition | None = None) -> Path:
    """Component file of a body, all its nodes; in a floating frame with its integrals there, or mean axes in basic."""
    path = folder / f"{component.name}.h5"
    frame = condition and floating_frame(component.body, component.Phi, component.rigid_count, condition)
    about = frame and IntegralFrame("frame", frame.origin, frame.axes)
    write_component(path, component, **PART, frame=frame, about=about)
    return path


def rigid_part(component: ModalComponent) -> RigidBody:
    """The body without deformation: mass properties of its finite elements."""
    found = modal_integrals(component.body, component.Phi[:, :0])
    c = found.centre_of_mass
    about_centre = found.inertia - found.mass * (c @ c * np.eye(3) - np.outer(c, c))
    return RigidBody(component.name, found.mass, c, about_centre, component.body.interfaces)


def joint(name: str, first: str, second: str, free: Sequence[int] = (RZ,), **options: Any) -> SceneJoint:
    """Joint along the axes of the scene between ``body.interface`` and ``body.interface``."""
    ends = [Point(*end.split(".")) for end in (first, second)]
    made = Joint(name, *ends, frozenset(free), **options)
    locked, arms = (tuple(set(range(6)) - set(free)),), np.array([made.offset or (0.0, 0.0, 0.0)])
    return SceneJoint(made, np.eye(3), np.eye(3), np.zeros(6), locked, arms, "")


def hinged(
    bodies: Sequence[RigidBody | ModalComponent],
    joints: Sequence[SceneJoint],
    folder: Path,
    *,
    ground: Sequence[str] = (),
    frames: Mapping[str, FrameCondition] | None = None,
    **options: Any,
) -> MultibodyScene:
    """Bodies where they are built, each joint with a motor of its name about every free motion."""
    names = tuple(body.name for body in bodies)
    motors = tuple(
        Channel(f"{each.joint.name}.{dof}", (JointTerm(each.joint.name, dof),), "rotation")
        for each in joints
        for dof in sorted(each.joint.free)
    )
    scene = Scene(
        names,
        (0.0, 1.0),
        tuple(each.joint for each in joints),
        actuators=motors,
        ground=tuple(Point(*point.split(".")) for point in ground),
        **options,
    )
    records = []
    for body in bodies:
        if isinstance(body, RigidBody):
            records.append(SceneBody(body.name, body.interfaces, Placement(), rigid=body))
        else:
            faces: Mapping[str, Interface] = body.body.interfaces
            records.append(
                SceneBody(body.name, faces, Placement(), file=written(folder, body, (frames or {}).get(body.name)))
            )
    return MultibodyScene("test", scene, Configuration("as built"), tuple(records), tuple(joints))


def simulate(scene: MultibodyScene, seconds: float, points: int = 20, **options: Any) -> Motion:
    """Motion of a scene whose flexible bodies are in their component files."""
    bodies = {body.name: floating_body(body.file) for body in scene.bodies if body.file is not None}
    return simulate_scene(scene, bodies, seconds, points=points, **options)
