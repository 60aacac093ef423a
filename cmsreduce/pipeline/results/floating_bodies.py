"""Bodies of a scene in their floating frames, from component files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from cmsreduce.errors import FloatingFrameError
from cmsreduce.model import MultibodyScene
from cmsreduce.simulate import FloatingBody, Marker, Stretch
from cmsreduce.write.component import flexible_body, frame_stiffening, read_component, require_mass, stored_integrals

__all__ = ["floating_bodies", "floating_body"]

_SIX = 6


def floating_bodies(scene: MultibodyScene) -> dict[str, FloatingBody]:
    """Flexible bodies of a scene by name; copies share what was read."""
    read: dict[Path, FloatingBody] = {}
    found = {}
    for body in scene.bodies:
        if body.file is not None:
            if body.file not in read:
                read[body.file] = floating_body(body.file)
            found[body.name] = replace(read[body.file], name=body.name)
    return found


def floating_body(path: Path) -> FloatingBody:
    """Read a body for simulation in time; its markers are the nodes of the file.

    Raises
    ------
    WriteError
        If the body has no integrals of second order, modes without mass, or structural damping.
    FloatingFrameError
        If it can move along some axes only, as a body in a plane.
    """
    component = read_component(path)
    integrals = stored_integrals(component)
    body = flexible_body(component, integrals)
    require_mass(body, "explicit integration in time needs the mass of every coordinate")
    if component.rigid_count not in (0, _SIX):
        raise FloatingFrameError(
            f"component '{component.name}': it has {component.rigid_count} rigid motions, and a frame that floats has "
            "six, or none if the body is held to the ground; reduce the body with all six dofs of its nodes"
        )
    stiffening = frame_stiffening(component, integrals)
    forces, moments = ({}, {}) if stiffening is None else (stiffening.force, stiffening.moment)
    markers = {
        str(node): Marker(place, translation, rotation, forces.get(node), moments.get(node))
        for node, place, translation, rotation in zip(
            body.node.tolist(), body.position, body.translation, body.rotation, strict=True
        )
    }
    return FloatingBody(
        name=body.name,
        mass=integrals.mass,
        first_moment=integrals.first_moment,
        second_moment=integrals.second_moment,
        phi=integrals.phi,
        r_phi=np.ascontiguousarray(integrals.r_phi),
        phi_phi=np.ascontiguousarray(integrals.phi_phi),
        M=body.mass,
        K=body.stiffness,
        D=body.damping,
        origin=integrals.origin,
        axes=integrals.axes,
        markers=markers,
        stretch=None
        if stiffening is None
        else Stretch.of(stiffening.acceleration, stiffening.turning, stiffening.spinning),
        held=component.rigid_count == 0,
    )
