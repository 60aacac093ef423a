"""Exudyn: the arrays that ObjectFFRFreducedOrderInterface.LoadFromFile reads from an .npz file."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ModalIntegrals, cross_matrix
from cmsreduce.write.component import ComponentFile, FlexibleBody, flexible_body
from cmsreduce.write.files import atomic_path

__all__ = ["write_exudyn"]

_FILE_VERSION = 1
_EULER_PARAMETERS = 4  # rotation coordinates of the node that carries the frame


def write_exudyn(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write the body for Exudyn's floating-frame object with reduced coordinates.

    Load it with ``cms = ObjectFFRFreducedOrderInterface(); cms.LoadFromFile("body.npz")``. Mesh node numbers in Exudyn
    count the file's nodes from 0, in the order of ``nodes/id``.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the origin of the frame that Exudyn moves.

    Raises
    ------
    WriteError
        If the component file lacks data, or the file cannot be written.
    """
    image = io.BytesIO()
    np.savez(image, **exudyn_arrays(flexible_body(component, integrals, slow=True)))  # type: ignore[arg-type]
    with atomic_path(path) as temporary:
        temporary.write_bytes(image.getvalue())


def exudyn_arrays(body: FlexibleBody) -> dict[str, NDArray[np.generic]]:
    """Arrays by the names of the attributes of Exudyn.

    Exudyn computes them as sums over nodes, with a mass matrix of translations only that is the same in all directions.
    Here they follow from the integrals, which hold for any mass, rotational inertia included.

    Source: Zwoelfer and Gerstmayr, Acta Mechanica 232 (2021), nodal-based floating frame with modal reduction.
    """
    integrals, k = body.integrals, body.k
    phi = np.moveaxis(integrals.phi, -1, 0)
    # S(a)^T S(b) = (a . b) 1 - b a^T, with S(a) b = a x b.
    r_phi = np.moveaxis(integrals.r_phi, -1, 0)
    phi_phi = np.moveaxis(integrals.phi_phi, (2, 3), (0, 1))
    trace = np.trace(phi_phi, axis1=2, axis2=3)
    double = trace[..., None, None] * np.eye(3) - np.swapaxes(phi_phi, -1, -2)
    single = np.trace(r_phi, axis1=1, axis2=2)[:, None, None] * np.eye(3) - np.swapaxes(r_phi, -1, -2)
    # S(a)^T b = -(a x b): axis, mode a, mode b.
    turning = -body.phi_cross_phi
    rigid = 3 + _EULER_PARAMETERS
    return {
        "modeBasis": body.translation.reshape(3 * body.node.size, k),
        "trigList": np.zeros((0, 3), dtype=np.int64),
        "postProcessingModes": np.array({}, dtype=object),
        "massMatrixReduced": body.mass,
        "stiffnessMatrixReduced": body.stiffness,
        "infoList": np.array([k, body.node.size, 3, _EULER_PARAMETERS, rigid, rigid + k]),
        "rigidBodyNodeType": np.array("NodeType.RotationEulerParameters"),
        "xRef": body.position.ravel(),
        "inertiaLocal": integrals.inertia,
        "Mtt": integrals.mass * np.eye(3),
        "totalMass": np.array(integrals.mass),
        "chiU": integrals.centre_of_mass,
        "chiUtilde": cross_matrix(integrals.centre_of_mass),
        "mPsiTildePsi": np.moveaxis(turning, 0, 1).reshape(3 * k, k),
        "mPsiTildePsiTilde": np.moveaxis(double, 2, 1).reshape(3 * k, 3 * k),
        "mPhitTPsi": integrals.phi,
        "mPhitTPsiTilde": np.hstack([*cross_matrix(phi), np.zeros((3, 0))]),
        "mXRefTildePsi": -integrals.r_cross_phi,
        "mXRefTildePsiTilde": np.hstack([*single, np.zeros((3, 0))]),
        "fileVersion": np.array(_FILE_VERSION),
        "type": np.array("ObjectFFRFreducedOrderInterface"),
        "units": np.array(body.units.name),
    }
