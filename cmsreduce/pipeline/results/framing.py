"""In which frame a body is written, and what shows that the frame holds what it says."""

from __future__ import annotations

import numpy as np

from cmsreduce.assemble import outboard_masses
from cmsreduce.config import BASIC, CENTRE
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import REMOVED, floating_frame, rigid_mass
from cmsreduce.model import Check, FEModel, FloatingFrame, IntegralFrame, OutboardMass, RigidBody
from cmsreduce.pipeline.run import Run
from cmsreduce.verify import rigid_mass_properties

__all__ = ["frame_checks", "frame_of", "integral_frame_of", "outboard_of"]


def frame_of(run: Run, name: str) -> FloatingFrame | None:
    """Floating frame that a body of a run is written in; None where none is asked for.

    Raises
    ------
    FloatingFrameError
        If the body has not six rigid motions, or its frame does not determine them.
    """
    keys = run.pipeline.write_of(name)
    if keys.frame is None:
        return None
    component = run.final[name]
    return floating_frame(
        component.body, component.Phi, component.rigid_count, keys.frame.condition(), keys.integrals.mass
    )


def frame_checks(frame: FloatingFrame | None) -> tuple[Check, ...]:
    """Whether the rigid motion of a frame is gone from the modes that are written in it."""
    if frame is None:
        return ()
    return (Check(f"rigid motion left in the modes: {frame.condition}", frame.residual, REMOVED),)


def integral_frame_of(run: Run, name: str, frame: FloatingFrame | None) -> IntegralFrame:
    """Where the integrals of a body of a run are taken about, along which axes, and over which mass.

    What the keys leave open is the floating frame's own place and axes.
    """
    body, keys = run.final[name].body, run.pipeline.write_of(name).integrals
    plain = IntegralFrame.basic(keys.mass)
    if body.nodes is None:
        return plain
    about, origin, axes = plain.about, plain.origin, plain.axes
    if keys.about is None and frame is not None:
        about, origin = f"origin of the floating frame: {frame.condition}", frame.origin
    elif keys.about == CENTRE:
        about, origin = "centre of mass", rigid_mass_properties(rigid_mass(body, lumping=keys.mass)).cg
    elif isinstance(keys.about, tuple):
        own = run.pipeline.components[name].units_in(run.scene.units)
        about, origin = "point given", np.array(keys.about) * own.length / run.scene.units.length
    elif keys.about not in (None, BASIC):
        about, origin = f"interface {keys.about}", body.interfaces[str(keys.about)].position[0]
    if keys.axes is None and frame is not None:
        axes = frame.axes
    elif keys.axes not in (None, BASIC):
        axes = body.interfaces[str(keys.axes)].frame
    return IntegralFrame(about, origin, axes, keys.mass)


def outboard_of(run: Run, name: str) -> tuple[OutboardMass, ...]:
    """What hangs on the interfaces of a body, outboard of it; nothing, with a note, where its mass is not known."""
    bodies: dict[str, FEModel | RigidBody] = {other: flexible.body for other, flexible in run.bodies.items()}
    try:
        return outboard_masses(run.bodies[name].body, {**bodies, **run.rigid_bodies}, run.scene)
    except SceneError as error:
        run.stages.note(f"{name}: the mass outboard of it is not in its file: {error}")
        return ()
