"""A body from a file that holds it reduced: a component file of this program, or a file of another one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import SCALAR, Damping, DofTable, Nodes, Source, Units
from cmsreduce.read import InterfaceSpec, ModalBody, is_sid, read_head, read_sid, sha256_of
from cmsreduce.write import ComponentFile, read_component

__all__ = ["read_reduced"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
# Loss factors of the modes that differ by less than this share are one: they are quotients of stored numbers.
_ONE_FACTOR = 1e-9


def read_reduced(name: str, path: Path, units: Units) -> ModalBody:
    """Read a reduced body; the content of the file tells what it is.

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
    if not path.is_file():
        raise ReadError(f"{path}: there is no such file")
    head = read_head(path, 4096)
    if head.startswith(_HDF5):
        return modal_body(name, path, read_component(path))
    if is_sid(head):
        return read_sid(name, path, units)
    raise ReadError(
        f"{path}: this is no reduced body: `reduced:` takes a component file (HDF5) of cmsreduce or an SID file. Give "
        "matrices of a superelement as `stiffness:`, `mass:` and `geometry:`"
    )


def modal_body(name: str, path: Path, file: ComponentFile) -> ModalBody:
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
