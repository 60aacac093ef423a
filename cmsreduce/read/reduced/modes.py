"""A body that is known by its modes: frequencies or modal matrices, and shapes at nodes, computed or measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import DofTable, RigidBody, Source, Units, cross_matrix, rigid_body_shapes
from cmsreduce.read.files import sha256_of
from cmsreduce.read.formats import Geometry
from cmsreduce.read.geometry import other_length, read_geometry
from cmsreduce.read.interfaces import MatrixSource
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.matrix import read_matrix, read_rows
from cmsreduce.read.reduced.modal_body import ModalBody

__all__ = ["read_modes", "with_rigid_motions"]

Array = NDArray[np.float64]

_UNPROVEN = "no rigid motion is among the given shapes, so nothing proves that each row belongs to its node"
# Rounding that an eigensolver leaves in the modal stiffness of rigid motions, relative to the largest entry.
_NO_STIFFNESS = 1e-13


def read_modes(
    name: str,
    *,
    shapes: MatrixSource,
    geometry: Path,
    rows: Path | str | None,
    units: Units,
    frequencies: tuple[float, ...] | None = None,
    modal_mass: tuple[float, ...] | None = None,
    stiffness: MatrixSource | None = None,
    mass: MatrixSource | None = None,
    rigid: RigidBody | None = None,
    grounded: bool = False,
) -> ModalBody:
    """Read a body by its modes.

    Parameters
    ----------
    name : str
        Name of the component.
    shapes : MatrixSource
        Shapes (p, m): rows are dofs of nodes, columns are modes.
    geometry : Path
        Deck or mesh with the nodes.
    rows : Path or str, optional
        Dofs of the rows: a list of node.component, or a dof set of the deck; by default the one that has p dofs.
    units : Units
        Unit system of the files.
    frequencies : tuple of float, optional
        In Hz, one a mode; 0 for a rigid motion.
    modal_mass : tuple of float, optional
        One a mode; 1 if absent.
    stiffness, mass : MatrixSource, optional
        Modal matrices (m, m) in place of frequencies.
    rigid : RigidBody, optional
        Mass properties of a free body whose shapes are elastic modes alone; its rigid motions are added.
    grounded : bool
        True if the body was held to the ground, and so has no rigid motion.

    Raises
    ------
    ReadError
        If a file cannot be read.
    DofMapError
        If the dofs of the rows are unknown.
    MatrixError
        If sizes disagree, or there are no rigid motions and the body is not held.
    """
    Phi = read_matrix(Path(shapes.path), shapes.matrix, shapes.format)
    shape = read_geometry(geometry)
    dofs = _dofs_of_rows(name, Phi, shape, rows)
    table = Phi.A.toarray()
    columns = f"'{Phi.name}' of {Phi.path} has {table.shape[1]} columns, one for each mode"
    if frequencies is not None and len(frequencies) != table.shape[1]:
        raise MatrixError(f"body '{name}': {len(frequencies)} frequencies are given, but {columns}")
    if frequencies is None:
        assert stiffness is not None and mass is not None
        read = [read_matrix(Path(one.path), one.matrix, one.format) for one in (stiffness, mass)]
        K, M = (one.A.toarray() for one in read)
    else:
        read = []
        M = np.diag(np.ones(len(frequencies)) if modal_mass is None else np.array(modal_mass))
        # Frequencies are in Hz, the matrices in the units of time of the body.
        K = np.diag((2 * np.pi * np.array(frequencies) * units.time) ** 2) @ M
    for matrix, what in ((K, "modal stiffness"), (M, "modal mass")):
        if matrix.shape != (table.shape[1],) * 2:
            raise MatrixError(f"body '{name}': its {what} is {matrix.shape[0]} x {matrix.shape[1]}, but {columns}")
    files = {Path(one.path): one.name for one in (Phi, *read)} | {shape.path: "geometry"}
    modal = ModalBody(
        name=name,
        K=_without_rounding(K, M),
        M=M,
        D=np.zeros_like(K),
        dofs=dofs,
        shapes=table,
        nodes=shape.nodes,
        units=units,
        rounding=max(Phi.rounding, *(one.rounding for one in read), 2.0**-53),
        remarks=other_length(name, shape, units),
        apart=bool(read),
        sources=tuple(Source(str(path), sha256_of(path), what) for path, what in files.items()),
    )
    return with_rigid_motions(modal, rigid, grounded)


def with_rigid_motions(modal: ModalBody, rigid: RigidBody | None, grounded: bool) -> ModalBody:
    """Modes with the rigid motions of a free body before them, made of its mass properties where these are given.

    Parameters
    ----------
    modal : ModalBody
        Modes as they were given.
    rigid : RigidBody, optional
        Mass properties of a free body whose modes are elastic ones alone.
    grounded : bool
        True if the body was held to the ground, and so has no rigid motion.

    Raises
    ------
    MatrixError
        If there are no rigid motions and the body is not held, or there are some already.
    """
    K, free = modal.K, not modal.K.any(axis=0).all()
    if rigid is None:
        if not free and not grounded:
            raise MatrixError(
                f"body '{modal.name}': none of its {K.shape[0]} modes is a rigid motion. Give the mass properties of a "
                "free body as `modes.rigid`, or its rigid motions as shapes of frequency 0; write `grounded: true` for "
                "a body that stands on the ground"
            )
        # Rigid motions among the given shapes prove the rows; those made from the places of the nodes do not.
        return replace(modal, unproven="" if free else _UNPROVEN)
    if free:
        raise MatrixError(
            f"body '{modal.name}': its modes hold rigid motions already (frequency 0), and `modes.rigid` adds others; "
            "take one of them out"
        )
    R = np.zeros((6, 6))
    R[:3, :3] = rigid.mass * np.eye(3)
    first = cross_matrix(rigid.mass * rigid.cg)
    R[:3, 3:], R[3:, :3] = -first, first
    R[3:, 3:] = rigid.inertia - rigid.mass * cross_matrix(rigid.cg) @ cross_matrix(rigid.cg)
    motions = rigid_body_shapes(modal.dofs, modal.nodes)
    # A motion that no row shows, such as one out of the plane of the shapes, is none of this body.
    shown = np.flatnonzero(motions.any(axis=0))
    zero = np.zeros((shown.size, shown.size))
    # Elastic modes of a free body have no momentum.
    return replace(
        modal,
        K=la.block_diag(zero, K),
        M=la.block_diag(R[np.ix_(shown, shown)], modal.M),
        D=la.block_diag(zero, modal.D),
        shapes=np.hstack([motions[:, shown], modal.shapes]),
        unproven=_UNPROVEN,
    )


def _dofs_of_rows(name: str, Phi: LabelledMatrix, shape: Geometry, rows: Path | str | None) -> DofTable:
    p = Phi.A.shape[0]
    if isinstance(rows, str):
        found = [shape.table(rows)]
    elif rows is not None:
        found = [read_rows(rows)]
    else:
        found = [table for table in shape.rows.values() if len(table) == p][:1]
    if not found or len(found[0]) != p:
        sizes = ", ".join(f"{label} {len(table)}" for label, table in shape.rows.items())
        raise DofMapError(
            f"body '{name}': '{Phi.name}' of {Phi.path} has {p} rows, "
            + (f"but `rows:` names {len(found[0])} dofs" if found else f"and {shape.path} has no dofs of that number")
            + f" ({sizes}). Give `rows:`, a list of node.component, one a line"
        )
    lost = shape.nodes.index(found[0].node) < 0
    if lost.any():
        raise DofMapError(f"body '{name}': node {found[0].node[lost.argmax()]} of the shapes is not in {shape.path}")
    return found[0]


def _without_rounding(K: Array, M: Array) -> Array:
    """Modal stiffness in which rigid motions have exactly none."""
    weight = np.sqrt(np.maximum(M.diagonal(), np.finfo(float).tiny))
    scaled = abs(K) / np.outer(weight, weight)
    free = scaled.max(axis=0) <= _NO_STIFFNESS * scaled.max(initial=0.0)
    return np.asarray(np.where(free[:, None] | free, 0.0, K))
