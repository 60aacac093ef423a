"""The keys of a component as a body: its files, its interfaces and ties, or its mass properties."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from cmsreduce.config import EXTSEOUT_NAMES, Component, InterfaceKeys, Pipeline, place_in
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import Tie, places_by_stiffness, tie_nodes
from cmsreduce.model import FEModel, Interface, RigidBody, Scene, Units, rigid_in_units
from cmsreduce.pipeline.bodies.modal_input import matrix_source, modal_input
from cmsreduce.read import (
    InterfaceSpec,
    MassOrder,
    Nearby,
    in_dofs,
    read_body,
    superelement_damping,
    superelement_matrices,
    with_inner_grids,
)

__all__ = ["AsRead", "body_as_read", "interface_specs", "read_rigid", "recovered_body", "tied_body"]


class AsRead(NamedTuple):
    """A body as its files have it, in their units and without ties.

    Parameters
    ----------
    body : FEModel
        The body.
    unproven : str
        Reason why its rows cannot be proven; empty if they can.
    remarks : tuple of str
        What was changed in reading it, and what is in doubt.
    mass_order : MassOrder, optional
        Order of the rows of its mass, where it is known without a comparison with the stiffness.
    """

    body: FEModel
    unproven: str = ""
    remarks: tuple[str, ...] = ()
    mass_order: MassOrder | None = None


def body_as_read(name: str, part: Component, units: Units) -> AsRead:
    """Read the body of a component as its files have it.

    Parameters
    ----------
    name : str
        Name of the component.
    part : Component
        Its keys.
    units : Units
        Unit system of its files.

    Raises
    ------
    CmsReduceError
        If a file cannot be read, or the keys contradict it.
    """
    interfaces = interface_specs(name, part, units)
    if part.in_modes:
        modal = modal_input(name, part, units)
        body = in_dofs(modal, interfaces)
        doubts = (f"{name}: {doubt}" for doubt in modal.doubts)
        return AsRead(body, modal.unproven, (*modal.remarks, *doubts), modal.order)
    assert part.stiffness is not None and part.mass is not None
    given = None if part.damping is None else part.damping.matrix
    matrix = None if given is None else matrix_source(given)
    stiffness, mass = matrix_source(part.stiffness), matrix_source(part.mass)
    damping = None if part.damping is None else part.damping.law()
    if part.extseout is not None and (stiffness.matrix, mass.matrix) == EXTSEOUT_NAMES:
        found = superelement_matrices(stiffness.path)
        stiffness, mass = found.stiffness, found.mass
        if part.damping is None:
            damping, matrix = superelement_damping(name, found)
    body = read_body(
        name,
        stiffness=stiffness,
        mass=mass,
        geometry=None if part.geometry is None else part.geometry.file,
        rows=None if part.rows is None else part.rows.file or part.rows.set,
        rows_trusted=part.rows is not None and part.rows.trusted,
        damping=damping,
        damping_matrix=matrix,
        units=units,
        grounded=part.grounded,
        interfaces=interfaces,
    )
    return AsRead(body, remarks=body.remarks)


def recovered_body(body: FEModel, part: Component) -> tuple[FEModel, str]:
    """Give a superelement the grids inside it where its files state their motion and mass.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    part : Component
        Its keys.

    Returns
    -------
    body : FEModel
        With the grids inside, or as it was.
    note : str
        Reason why recovery matrices of the files are not used; empty if they are, or there are none.
    """
    if part.stiffness is None or part.geometry is None or part.geometry.file is None:
        return body, ""
    found, reason = with_inner_grids(body, part.stiffness.file, part.geometry.file)
    return found, reason and f"{body.name}: the recovery matrix MUG1 of {part.stiffness.file} is not used: {reason}"


def tied_body(body: FEModel, part: Component, free: bool) -> FEModel:
    """Tie the nodes of interfaces as the keys of a component say.

    Parameters
    ----------
    body : FEModel
        As its files have it.
    part : Component
        Its keys.
    free : bool
        True if the body moves freely in all six motions. Its ties need the coordinates that its stiffness has.

    Raises
    ------
    SceneError
        If the nodes cannot be tied.
    """
    if free and any(keys.tie is not None for keys in part.interfaces.values()):
        body = places_by_stiffness(body)
    for label, keys in part.interfaces.items():
        if keys.tie is not None:
            position = None if keys.position is None else place_in(keys.position, body.units)
            frame = None if keys.frame is None else keys.frame.rows()
            body = tie_nodes(body, label, Tie(keys.tie, position, keys.weights, frame))
    return body


def read_rigid(pipeline: Pipeline, name: str, scene: Scene) -> RigidBody:
    """Make a rigid body of a pipeline, in the scene's units.

    Raises
    ------
    SceneError
        If one of its interfaces is given by nodes.
    """
    part = pipeline.components[name]
    assert part.rigid is not None
    faces, units = {}, part.units_in(scene.units)
    for label, keys in part.interfaces.items():
        if keys.position is None:
            raise SceneError(f"'{name}.{label}': a rigid body has no nodes; give the interface a `position: [x, y, z]`")
        frame = np.eye(3) if keys.frame is None else keys.frame.rows()
        faces[label] = Interface(
            label,
            np.array([-1]),
            (tuple(sorted(keys.components)),),
            place_in(keys.position, units)[None],
            frame,
            np.eye(3)[None],
        )
    body = RigidBody(name, part.rigid.mass, place_in(part.rigid.cg, units), part.rigid.tensor(), faces, units)
    momentum = np.sum([wheel.vector(scene.units) for wheel in part.wheels.values()] or [np.zeros(3)], axis=0)
    spun = {
        parameter: np.sum([part.wheels[wheel].direction for wheel in turned], axis=0) / keys.unit.number_in(scene.units)
        for parameter, keys in pipeline.scene.parameters.items()
        if (turned := [wheel for wheel in part.wheels if f"{name}.{wheel}" in keys.wheels])
    }
    return replace(rigid_in_units(body, scene.units), momentum=momentum, spun=spun)


def interface_specs(name: str, part: Component, units: Units) -> dict[str, InterfaceSpec]:
    """Interfaces of the keys of a component, in units of length of its files.

    Raises
    ------
    SceneError
        If one is at a position that no tie joins with nodes.
    """
    return {label: _interface(label, name, keys, units) for label, keys in part.interfaces.items()}


def _interface(label: str, body: str, keys: InterfaceKeys, units: Units) -> InterfaceSpec:
    if keys.position is not None and keys.tie is None:
        raise SceneError(
            f"'{body}.{label}': a flexible body is joined at its nodes; give `node:` or `near:`, not `position:`"
        )
    nodes = (keys.node,) if keys.node is not None else keys.nodes
    dofs = None if keys.dofs is None else "".join(str(c) for c in sorted(keys.components))
    near = None
    if keys.near is not None and keys.within is not None:
        x, y, z = place_in(keys.near, units).tolist()
        near = Nearby((x, y, z), keys.within.length_in(units), keys.match == "nearest")
    return InterfaceSpec(nodes, dofs, keys.set, None if keys.frame is None else keys.frame.rows(), near)
