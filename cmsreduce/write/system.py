"""The file system.h5: the assembled reduced system in every configuration."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.eigen import elastic_pairs
from cmsreduce.model import DOF_NAMES, Joint, Matrix, System, Units
from cmsreduce.write.files import hdf5_file, put, put_json, put_texts, put_units
from cmsreduce.write.seal import put_seal

__all__ = ["JOINT_BODIES", "QUANTITIES", "SYSTEM_FORMAT", "SYSTEM_FORMAT_VERSION", "SYSTEM_MATRICES", "write_system"]

SYSTEM_FORMAT = "cmsreduce-system"
"""Attribute ``format`` of the file."""

SYSTEM_FORMAT_VERSION = 2
"""Attribute ``format_version`` that this version writes."""

SYSTEM_MATRICES = {
    "M": "mass",
    "K": "stiffness",
    "D": "viscous damping",
    "loss": "imaginary part of a complex stiffness",
    "B": "columns: inputs",
    "C1": "rows: outputs, of the displacements",
    "C2": "rows: outputs, of the rates",
    "T": "coordinates of the bodies, stacked in their order = T x",
    "rigid": "columns: rigid motions and free motions of the joints, orthonormal in M",
}
"""Matrices of a configuration, with what they are."""

QUANTITIES = ("input_quantities", "output_quantities")
"""Datasets of what each input and each output is."""

JOINT_BODIES = "joint "
"""Names of the bodies of joints' elements begin so: `Joint.own_body`."""

_ELEMENTS = {
    "stiffness": "of the second interface against the first, in K",
    "damping": "of the second interface against the first, in D",
    "inertia": "of the joint itself, turning with the first interface, in M; in no body's mass",
}


def write_system(
    path: Path,
    systems: Sequence[System],
    *,
    provenance: Mapping[str, Any],
    units: Units | None = None,
    quantities: tuple[Sequence[str], Sequence[str]] | None = None,
) -> None:
    """Write the assembled reduced system.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    systems : sequence of System
        One for each configuration. Sparse matrices, as of an unreduced body, are written by compressed columns.
    provenance : mapping
        JSON values: settings, notes.
    units : Units, optional
        Unit system of the scene.
    quantities : tuple of two sequences of str, optional
        What each input and each output is: ``force``, ``torque``; ``translation``, ``rotation``, with `` rate``;
        ``combination``.

    Raises
    ------
    WriteError
        If the file cannot be written.
    MatrixError
        If a system has free motions that its ``rigid`` does not name.
    """
    with hdf5_file(path) as file:
        file.attrs["format"] = SYSTEM_FORMAT
        file.attrs["format_version"] = SYSTEM_FORMAT_VERSION
        file.attrs["created_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
        if units is not None:
            put_units(file.create_group("units"), units)
        put_json(file.create_group("provenance"), provenance)
        for number, system in enumerate(systems):
            group = file.create_group(f"configuration_{number}")
            group.attrs["name"] = system.configuration.name
            group.attrs["rounding"] = system.rounding
            for (joint, dof), value in system.configuration.angles.items():
                group.attrs[f"setting {joint}.{DOF_NAMES[dof]}"] = value
            for name, value in system.configuration.parameters.items():
                group.attrs[f"parameter {name}"] = value
            put_texts(group, "bodies", system.sizes, "in the order of the rows of T")
            put(group, "sizes", np.array(list(system.sizes.values()), dtype=np.int64), "", "coordinates of each body")
            put_texts(group, "inputs", system.inputs)
            put_texts(group, "outputs", system.outputs)
            if quantities is not None:
                for name, values in zip(QUANTITIES, quantities, strict=True):
                    put_texts(group, name, values)
            put_texts(group, "notes", system.notes)
            _put_joints(group.create_group("joints"), system.joints)
            for name, about in SYSTEM_MATRICES.items():
                matrix = getattr(system, name)
                if matrix is not None:
                    _put_matrix(group, name, matrix, about)
            if not sp.issparse(system.K):
                put(group, "frequency_hz", _frequencies(system), "Hz", "undamped, the zero ones first")
        put_seal(file)


def _put_joints(group: Any, joints: Iterable[Joint]) -> None:
    """Write the joints, and what their springs, dampers and inertias add to K, D and M."""
    for joint in joints:
        own = group.create_group(joint.name)
        own.attrs["first"], own.attrs["second"] = str(joint.first), str(joint.second)
        own.attrs["free"] = " ".join(DOF_NAMES[dof] for dof in sorted(joint.free))
        if not joint.elements:
            continue
        own.attrs["body"] = joint.own_body
        put_texts(own, "dof", [DOF_NAMES[element.dof] for element in joint.elements])
        for name, about in _ELEMENTS.items():
            put(own, name, np.array([getattr(element, name) for element in joint.elements]), about=about)


def _frequencies(system: System) -> NDArray[np.float64]:
    squared, _ = elastic_pairs(np.asarray(system.K), np.asarray(system.M), system.rigid, system.rounding)
    # Round-off may make the squared frequency of a soft mode slightly negative.
    omega = np.concatenate([np.zeros(system.rigid.shape[1]), np.sqrt(np.maximum(squared, 0.0))])
    return np.asarray(omega / (2 * np.pi))


def _put_matrix(group: Any, name: str, matrix: Matrix, about: str) -> None:
    if not sp.issparse(matrix):
        put(group, name, matrix, about=about)
        return
    columns = sp.csc_array(matrix)
    parts = group.create_group(name)
    parts.attrs["about"] = f"{about}; compressed sparse columns"
    put(parts, "shape", np.array(columns.shape, dtype=np.int64))
    for part in ("data", "indices", "indptr"):
        put(parts, part, getattr(columns, part))
