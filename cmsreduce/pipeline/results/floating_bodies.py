"""Bodies of a scene in their floating frames, from component files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import FloatingFrameError
from cmsreduce.model import ModalIntegrals, MultibodyScene, Values, varied
from cmsreduce.simulate import FloatingBody, Marker, Stretch
from cmsreduce.write import ComponentFile
from cmsreduce.write.component import (
    FlexibleBody,
    flexible_body,
    frame_stiffening,
    read_component,
    require_mass,
    stored_integrals,
)

__all__ = ["floating_bodies", "floating_body"]

Array = NDArray[np.float64]

_SIX = 6
# Share of the largest entry that a change of frame may leave on a rigid motion that is not resisted.
_ROUNDING = 1e-10


def floating_bodies(scene: MultibodyScene) -> dict[str, FloatingBody]:
    """Flexible bodies of a scene by name; copies share what was read."""
    read: dict[Path, FloatingBody] = {}
    found = {}
    for body in scene.bodies:
        if body.file is not None:
            if body.file not in read:
                read[body.file] = floating_body(body.file, scene.configuration.parameters)
            found[body.name] = replace(read[body.file], name=body.name)
    return found


def floating_body(path: Path, values: Values | None = None) -> FloatingBody:
    """Read a body for simulation in time; its markers are the nodes of the file.

    Parameters
    ----------
    path : Path
        Component file.
    values : mapping of parameter to float, optional
        Values of the parameters that change its stiffness and damping.

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
    K, D = _with_parameters(component, integrals, body, values or {})
    G = varied(component.gyroscopic, component.parameter_terms, "G", values or {})
    return FloatingBody(
        name=body.name,
        mass=integrals.mass,
        first_moment=integrals.first_moment,
        second_moment=integrals.second_moment,
        phi=integrals.phi,
        r_phi=np.ascontiguousarray(integrals.r_phi),
        phi_phi=np.ascontiguousarray(integrals.phi_phi),
        M=body.mass,
        K=K,
        D=D,
        origin=integrals.origin,
        axes=integrals.axes,
        markers=markers,
        stretch=None
        if stiffening is None
        else Stretch.of(stiffening.acceleration, stiffening.turning, stiffening.spinning),
        held=component.rigid_count == 0,
        gyroscopic=None if G is None else _over_speeds(component, integrals, np.asarray(G)),
    )


def _over_speeds(component: ComponentFile, integrals: ModalIntegrals, G: Array) -> Array:
    """Gyroscopic matrix over velocity and angular velocity of the frame and the rates of the deforming modes.

    The rigid modes are orthonormal in the mass: a rigid motion u has the amplitudes Phi_r^T M u, its momentum in them.
    """
    columns, rigid = integrals.modes, slice(0, component.rigid_count)
    S = np.zeros((component.omega.size, _SIX + columns.size))
    S[columns, _SIX + np.arange(columns.size)] = 1.0
    if component.rigid_count:
        A, momentum = integrals.axes, component.arrays["integrals/int_phi"][:, rigid]
        turning = component.arrays["integrals/int_r_x_phi"][:, rigid]
        S[rigid, :3] = (A @ momentum).T
        S[rigid, 3:_SIX] = (A @ (turning - np.cross(integrals.origin, momentum, axisb=0, axisc=0))).T
    return S.T @ G @ S


def _with_parameters(
    component: ComponentFile, integrals: ModalIntegrals, body: FlexibleBody, values: Values
) -> tuple[Array, Array]:
    """Stiffness and damping of the deforming modes at some values of the parameters.

    A parameter that changes the mass changes the modal integrals, and one that resists rigid motion acts on the frame:
    both are refused.
    """
    acting = [term for term in component.parameter_terms if term.factor(values) and not term.gyroscopic]
    columns = integrals.modes
    rigid = np.setdiff1d(np.arange(component.omega.size), columns)
    for term in acting:
        if term.letter == "M" or abs(term.dense[rigid]).max(initial=0.0) > _ROUNDING * abs(term.dense).max():
            what = "the mass, and so the modal integrals" if term.letter == "M" else "the rigid motion of the body"
            raise FloatingFrameError(
                f"component '{component.name}': the parameter '{term.parameter}' changes {what}, which a file for one "
                "value does not hold; write the body for this configuration (`write: {configuration: NAME}`), or take "
                "one in which it is zero"
            )
    own = [term.within(columns) for term in acting]
    K, D = varied(body.stiffness, own, "K", values), varied(body.damping, own, "D", values)
    return np.asarray(K), np.asarray(D)
