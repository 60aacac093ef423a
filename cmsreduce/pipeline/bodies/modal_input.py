"""A body in modes, by the keys of a component: a file that holds it reduced, or its modes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import Component, MatrixFile
from cmsreduce.errors import DampingError, ReadError, SceneError, UnitsError
from cmsreduce.model import SCALAR, Damping, DofTable, Nodes, RigidBody, Source, Units
from cmsreduce.read import InterfaceSpec, MatrixSource, ModalBody, file_kind, read_modes, read_sid, sha256_of
from cmsreduce.write import ComponentFile, read_component

__all__ = ["matrix_source", "modal_input"]

# Loss factors of the modes that differ by less than this share are one: they are quotients of stored numbers.
_ONE_FACTOR = 1e-9


def modal_input(name: str, part: Component, units: Units) -> ModalBody:
    """Read a body that is given by `reduced` or `modes`, with the damping of its file unless the keys state another.

    Raises
    ------
    CmsReduceError
        If its files cannot be read, or the keys contradict them.
    """
    if part.reduced is not None:
        modal = _of_file(name, part.reduced, units)
        if part.units is not None and modal.units != units:
            raise UnitsError(
                f"component '{name}': {part.reduced} states the units {modal.units.name}, the pipeline {units.name}; "
                "take `units` out"
            )
    else:
        modal = _of_modes(name, part, units)
    tied = [label for label, keys in part.interfaces.items() if keys.tie is not None]
    if tied:
        remedy = "tie them where it is reduced" if part.modes is None else "give the shapes at one node with six dofs"
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
    assert keys is not None and part.geometry is not None
    rigid = keys.rigid
    return read_modes(
        name,
        shapes=matrix_source(keys.shapes),
        geometry=part.geometry.file,
        rows=None if part.rows is None else part.rows.file or part.rows.set,
        units=units,
        frequencies=keys.frequencies,
        modal_mass=keys.modal_mass,
        stiffness=None if keys.stiffness is None else matrix_source(keys.stiffness),
        mass=None if keys.mass is None else matrix_source(keys.mass),
        rigid=None if rigid is None else RigidBody(name, rigid.mass, np.array(rigid.cg), rigid.tensor()),
        grounded=part.grounded,
    )


def _of_file(name: str, path: Path, units: Units) -> ModalBody:
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
    if kind.name == "sid":
        return read_sid(name, path, units)
    raise ReadError(
        f"{path}: this is {kind.words}, no reduced body: `reduced:` takes a component file of cmsreduce or an SID "
        "file. Give matrices of a superelement as `stiffness:`, `mass:` and `geometry:`"
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
    )


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
