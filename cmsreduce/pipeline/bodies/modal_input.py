"""A body in modes, by the keys of a component: a file that holds it reduced, or its modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.config import Component, MatrixFile, place_in
from cmsreduce.errors import DampingError, ReadError, SceneError, UnitsError
from cmsreduce.mechanics import integrals_about, mass_points
from cmsreduce.model import SCALAR, Damping, DofTable, Nodes, RigidBody, SecondOrder, Source, Units
from cmsreduce.read import (
    InterfaceSpec,
    MatrixSource,
    ModalBody,
    file_kind,
    read_mbdyn,
    read_modes,
    read_sid,
    read_states,
    read_universal_modes,
    sha256_of,
)
from cmsreduce.write import SAME_MASS, ComponentFile, read_component, stored_integrals

__all__ = ["REDUCED_FILES", "matrix_source", "modal_input", "reduced_body"]

_INTEGRALS = (
    "integrals/rigid_mass",
    "integrals/int_phi",
    "integrals/int_r_x_phi",
    "integrals/r_phi",
    "integrals/phi_phi",
)
# Loss factors of the modes that differ by less than this share are one: they are quotients of stored numbers.
_ONE_FACTOR = 1e-9
_READERS = {"sid": read_sid, "mbdyn": read_mbdyn}

REDUCED_FILES = frozenset(_READERS)
"""Kinds of files of other programs that hold a reduced body."""


def modal_input(name: str, part: Component, units: Units) -> ModalBody:
    """Read a body that is given by `reduced` or `modes`, with the damping of its file unless the keys state another.

    Raises
    ------
    CmsReduceError
        If its files cannot be read, or the keys contradict them.
    """
    if part.reduced is not None:
        modal = reduced_body(name, part.reduced, units)
        if part.units is not None and modal.units != units:
            raise UnitsError(
                f"component '{name}': {part.reduced} states the units {modal.units.name}, the pipeline {units.name}; "
                "take `units` out"
            )
    elif part.states is not None:
        assert part.geometry is not None and part.rows is not None and part.rows.file is not None
        modal = read_states(
            name,
            part.states.file,
            part.states.matrix,
            geometry=part.geometry.file,
            rows=part.rows.file,
            units=units,
            grounded=part.grounded,
        )
    else:
        modal = _of_modes(name, part, units)
    tied = [label for label, keys in part.interfaces.items() if keys.tie is not None]
    if tied:
        remedy = (
            "tie them where it is reduced" if part.reduced is not None else "give the shapes at one node with six dofs"
        )
        raise SceneError(f"'{name}.{tied[0]}': nodes of a body that is given by modes cannot be tied; {remedy}")
    if part.damping is None:
        return modal
    if part.damping.matrix is not None:
        raise DampingError(
            f"component '{name}': the rows of a reduced body are no dofs of a damping matrix; state a damping law"
        )
    return replace(modal, damping=part.damping.law())


def matrix_source(keys: MatrixFile) -> MatrixSource:
    """A matrix in a file, by its keys."""
    return MatrixSource(keys.file, keys.matrix, keys.format)


def _of_modes(name: str, part: Component, units: Units) -> ModalBody:
    keys = part.modes
    assert keys is not None
    rigid = None
    if keys.rigid is not None:
        rigid = RigidBody(name, keys.rigid.mass, place_in(keys.rigid.cg, units), keys.rigid.tensor())
    geometry = None if part.geometry is None else part.geometry.file
    if keys.file is not None:
        if part.rows is not None:
            raise SceneError(f"component '{name}': {keys.file} names the node of each shape; take `rows` out")
        return read_universal_modes(
            name,
            keys.file,
            geometry=geometry,
            units=units,
            modal_mass=keys.modal_mass,
            rigid=rigid,
            grounded=part.grounded,
        )
    assert keys.shapes is not None and geometry is not None
    return read_modes(
        name,
        shapes=matrix_source(keys.shapes),
        geometry=geometry,
        rows=None if part.rows is None else part.rows.file or part.rows.set,
        units=units,
        frequencies=keys.frequencies,
        modal_mass=keys.modal_mass,
        stiffness=None if keys.stiffness is None else matrix_source(keys.stiffness),
        mass=None if keys.mass is None else matrix_source(keys.mass),
        rigid=rigid,
        grounded=part.grounded,
    )


def reduced_body(name: str, path: Path, units: Units) -> ModalBody:
    """Reduced body of a file, whose content tells what it is.

    Parameters
    ----------
    name : str
        Name of the component.
    path : Path
        The file.
    units : Units
        Unit system of a file that states none.

    Raises
    ------
    ReadError
        If the file is missing, damaged, or holds no reduced body.
    """
    kind = file_kind(path)
    if kind.name == "component":
        return _of_component(name, path, read_component(path))
    if kind.name in _READERS:
        return _READERS[kind.name](name, path, units)
    raise ReadError(
        f"{path}: this is {kind.words}, no reduced body: `reduced:` takes a component file of cmsreduce, an SID "
        "file or a modal body of MBDyn. Give matrices of a superelement as `stiffness:`, `mass:` and `geometry:`"
    )


def _of_component(name: str, path: Path, file: ComponentFile) -> ModalBody:
    """The body of a component file.

    Raises
    ------
    ReadError
        If it has no nodes, or a complex stiffness that is no loss factor.
    """
    arrays = file.arrays
    if "nodes/id" not in arrays:
        raise ReadError(
            f"{path}: the body has no geometry, so that no joint can find its nodes; use its matrices instead"
        )
    nodes = Nodes(arrays["nodes/id"], arrays["nodes/xyz"], arrays["nodes/frame"])
    moving = np.flatnonzero(arrays["dofs/component"] != SCALAR)
    dofs = DofTable(arrays["dofs/node"][moving], arrays["dofs/component"][moving])
    sets = {
        face: InterfaceSpec(members, None, None, arrays[f"interfaces/{face}/frame"])
        for face, members in file.interfaces.items()
    }
    return ModalBody(
        name=name,
        K=np.array(arrays["modes/stiffness"]),
        M=np.array(arrays["modes/mass"]),
        D=np.array(arrays["modes/damping"]),
        dofs=dofs,
        shapes=arrays["dofs/shapes"][moving],
        nodes=nodes,
        sets=sets,
        damping=_damping(path, arrays["modes/stiffness"], arrays.get("modes/loss")),
        units=Units.parse(str(file.attributes["units"]["name"])),
        sources=(Source(str(path), sha256_of(path), f"component {file.name}"),),
        second_order=_second_order(file),
        G=file.gyroscopic,
    )


def _second_order(file: ComponentFile) -> SecondOrder | None:
    """Integrals of second order of all modes about the basic origin; None if they are not of the modal mass."""
    arrays = file.arrays
    if not set(_INTEGRALS) <= arrays.keys() or str(file.attributes["integrals"].get("lumping", "")) != "consistent":
        return None
    found = integrals_about(stored_integrals(file), np.zeros(3), np.eye(3))
    if abs(np.einsum("iiab->ab", found.phi_phi) - arrays["modes/mass"][np.ix_(found.modes, found.modes)]).max(
        initial=0.0
    ) > SAME_MASS * abs(arrays["modes/mass"]).max(initial=0.0):
        return None
    rigid = np.setdiff1d(np.arange(file.omega.size), found.modes)
    momentum = np.vstack([arrays["integrals/int_phi"], arrays["integrals/int_r_x_phi"]])[:, rigid]
    # Rigid modes are rigid motions about the basic origin.
    motions = la.lstsq(arrays["integrals/rigid_mass"], momentum)[0]
    order = np.concatenate([rigid, found.modes])
    return mass_points(found).second_order(motions).of(np.eye(file.omega.size)[order])


def _damping(path: Path, K: NDArray[np.float64], loss: NDArray[np.float64] | None) -> Damping:
    """Damping law: none beside a damping matrix, a loss factor where the stiffness is complex."""
    if loss is None or not loss.any():
        return Damping()
    stiff = K.diagonal() > 0
    factors = loss.diagonal()[stiff] / K.diagonal()[stiff]
    if np.ptp(factors) > _ONE_FACTOR * factors.max():
        raise ReadError(
            f"{path}: its modes have loss factors from {factors.min():g} to {factors.max():g}; one is needed"
        )
    return Damping(structural=float(factors.mean()))
