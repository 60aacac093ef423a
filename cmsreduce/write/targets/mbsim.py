"""MBSim: the HDF5 input file of an external flexible body (FlexibleBodyFFR)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.model import ModalIntegrals
from cmsreduce.write.component import ComponentFile, flexible_body, refuse_long_ids, require_mass
from cmsreduce.write.files import hdf5_file

__all__ = ["write_mbsim"]

_PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def write_mbsim(path: Path, component: ComponentFile, integrals: ModalIntegrals) -> None:
    """Write the body for MBSim.

    MBSim reads the datasets by name and computes inertia, coupling and centrifugal terms from them.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the frame that MBSim moves.

    Raises
    ------
    WriteError
        If the component file lacks data, a mode has no mass, a node's number has more than 31 bits, or the file cannot
        be written.
    """
    body = flexible_body(component, integrals)
    require_mass(body, "MBSim solves with the modal mass")
    refuse_long_ids(component, body.node, "MBSim")
    n, k = body.node.size, body.k
    with hdf5_file(path) as file:
        file.attrs["units"] = body.units.name
        for name, values in {
            "mass": integrals.mass,
            "position integral": integrals.first_moment,
            "position position integral": integrals.second_moment,
            "shape function integral": integrals.phi,
            "position shape function integral": integrals.r_phi.reshape(9, k),
            "shape function shape function integral": np.vstack([integrals.phi_phi[i, j] for i, j in _PAIRS]),
            "stiffness matrix": body.stiffness,
            "damping matrix": body.damping,
            "node numbers": body.node.astype(np.int32),
            "nodal relative position": body.position.ravel(),
            "nodal shape matrix of translation": body.translation.reshape(3 * n, k),
            "nodal shape matrix of rotation": body.rotation.reshape(3 * n, k),
        }.items():
            # MBSim reads only plain datasets.
            file.create_dataset(name, data=values, track_times=False)
