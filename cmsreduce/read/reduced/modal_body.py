"""A body in amplitudes of modes, and the same body in the dofs of its interfaces, as a superelement has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError, SceneError
from cmsreduce.model import (
    DOUBLE,
    SCALAR,
    SI,
    Damping,
    DofTable,
    FEModel,
    Nodes,
    ParameterTerm,
    Recovery,
    SecondOrder,
    Source,
    Units,
)
from cmsreduce.read.interfaces import InterfaceSpec, resolve_interface
from cmsreduce.read.reduced.rigid_shapes import elastic_doubts, prove_rigid_shapes
from cmsreduce.read.row_order import MassOrder, prove_row_order

__all__ = ["ModalBody", "in_dofs"]

# Interface dofs whose motions differ by less than this share of their size move together: shapes of files have six to
# sixteen digits, and a quotient of two of their sizes has up to three digits less.
_TOGETHER = 1e-7
# Roundings of the shapes below which a motion is none: it is a sum of several shapes.
_ROUNDINGS = 10.0
# Coordinates have unit strain energy, so that a combination with less than this share of it is a rigid motion.
_FREE = 1e-13
# Deformation below this share of a motion is the rounding of a rigid one.
_RIGID = 1e-10
# Modal masses that differ by less than this share are alike.
_ALIKE = 1e-9

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class ModalBody:
    """A body in m coordinates, whose motion is known at some nodes.

    Parameters
    ----------
    name : str
        Name of the body.
    K, M, D : (m, m) float64
        Modal matrices. Coordinates of rigid motion are among them; they have no stiffness.
    dofs : DofTable
        p dofs whose motion is known.
    shapes : (p, m) float64
        Their motion per unit of each coordinate, along the displacement frames of the nodes.
    nodes : Nodes
        Places of the nodes.
    sets : mapping of name to InterfaceSpec
        Interfaces that the file names.
    damping : Damping
        Damping law, where D is zero.
    units : Units
        Unit system of the file.
    rounding : float
        Relative rounding of its numbers.
    sources : tuple of Source
        Files that it was read from.
    unproven : str
        Reason why rigid motions prove nothing about the places of the shapes, if they were made from these places.
    second_order : SecondOrder, optional
        Integrals of second order of the coordinates, about the basic origin, where the file states them.
    remarks : tuple of str
        What was changed in reading it, with figures.
    G : (m, m) float64, optional
        Gyroscopic matrix.
    apart : bool
        True if K and M were given as matrices of their own, so that the coordinates of one may be in another order.
    """

    name: str
    K: Array
    M: Array
    D: Array
    dofs: DofTable
    shapes: Array
    nodes: Nodes
    sets: Mapping[str, InterfaceSpec] = field(default_factory=dict)
    damping: Damping = field(default_factory=Damping)
    units: Units = SI
    rounding: float = 2.0**-53
    sources: tuple[Source, ...] = ()
    unproven: str = ""
    second_order: SecondOrder | None = None
    remarks: tuple[str, ...] = ()
    G: Array | None = None
    apart: bool = False

    @cached_property
    def doubts(self) -> tuple[str, ...]:
        """Reasons to doubt the elastic shapes."""
        return elastic_doubts(self.dofs, self.shapes, self.M.diagonal(), _free(self), self.rounding)

    @property
    def order(self) -> MassOrder | None:
        """Order of the modal masses against the stiffnesses, where it is known; one change of coordinates keeps it."""
        mass = self.M.diagonal()
        if not self.apart:
            return MassOrder("modal", remark="each mode has its frequency and its modal mass from one record")
        if abs(self.M - mass.mean() * np.eye(mass.size)).max(initial=0.0) > _ALIKE * abs(mass).max(initial=0.0):
            return None
        return MassOrder("modal", remark="all modal masses are alike, so that they have no order")


def in_dofs(modal: ModalBody, interfaces: Mapping[str, InterfaceSpec]) -> FEModel:
    """Change a modal body to the dofs of its interfaces and further coordinates, which leave these at rest.

    Parameters
    ----------
    modal : ModalBody
        m coordinates.
    interfaces : mapping of name to InterfaceSpec
        Places at which joints attach: nodes, or ``set`` for an interface that the file names.

    Returns
    -------
    FEModel
        m rows: dofs of the interfaces and as many further ones as hold its rigid motions, then scalar coordinates.
        The other dofs whose motion is known follow them.

    Raises
    ------
    SceneError
        If an interface is not in the file.
    MatrixError
        If the modes cannot move the dofs of the interfaces one by one.
    DofMapError
        If rigid motion of the nodes costs force, or shapes without stiffness are no rigid motions of the nodes: shapes,
        places and stiffness are not of one body.

    Notes
    -----
    With Phi the shapes at the rows u, the coordinates are q = A u + N p, where Phi N = 0, Phi A = 1 and N^T K A = 0
    (Craig, Bampton 1968): u moves the body as a static load on the rows would. Nothing is left out.
    """
    faces = {face: _spec(modal, face, spec) for face, spec in interfaces.items()}
    resolved = {
        face: resolve_interface(modal.name, face, spec, modal.dofs, modal.nodes, {}) for face, spec in faces.items()
    }
    named = [
        modal.dofs.rows_of(int(node), parts)
        for face in resolved.values()
        for node, parts in zip(face.node, face.components, strict=True)
    ]
    at_faces = np.array(list(dict.fromkeys(int(row) for rows in named for row in rows)), dtype=np.int64)
    _check_independent(modal, at_faces)
    prove_rigid_shapes(modal.name, modal.dofs, modal.nodes, modal.shapes[:, _free(modal)], modal.rounding)
    rows = _with_rigid_motions(modal, at_faces)
    T = _change(modal, rows)
    K, M, D = (T.T @ A @ T for A in (modal.K, modal.M, modal.D))
    # Both are zero but for rounding, and so are the forces on rows that rigid motions alone move.
    K[: rows.size, rows.size :] = K[rows.size :, : rows.size] = 0.0
    for full, changed in ((modal.K, K), (modal.D, D)):
        rigid = np.flatnonzero(changed.diagonal()[: rows.size] <= _RIGID**2 * _energies(modal, full, rows))
        changed[rigid] = changed[:, rigid] = 0.0
    others = np.setdiff1d(np.arange(len(modal.dofs)), rows)
    count = T.shape[1] - rows.size
    first = int(max(modal.nodes.id.max(initial=0), modal.dofs.node.max(initial=0))) + 1
    scalar = DofTable(np.arange(first, first + count), np.full(count, SCALAR, dtype=np.int8))
    table = modal.dofs[rows].joined(scalar)
    body = FEModel(
        modal.name,
        sp.csc_array(K),
        sp.csc_array(M),
        table,
        nodes=modal.nodes,
        interfaces=resolved,
        damping=modal.damping,
        D=sp.csc_array(D) if D.any() and modal.damping.law == "none" else None,
        units=modal.units,
        rounding=modal.rounding,
        # Rounded shapes leave forces that cancel in exact ones, and those of another size beside them.
        noise=modal.rounding,
        tied=Recovery(modal.dofs[others], table, sp.csr_array(modal.shapes[others] @ T)) if others.size else None,
        second_order=modal.second_order and modal.second_order.of(T),
        grounded=not _free(modal).size,
        sources=modal.sources,
        terms=() if modal.G is None else (ParameterTerm("", "G", sp.csc_array(T.T @ modal.G @ T), 0),),
    )
    try:
        proof = prove_row_order(body)
    except DofMapError as error:
        if not modal.doubts:
            raise
        cause = "; ".join(modal.doubts)
        raise DofMapError(f"{str(error).partition('. Likely cause')[0]}. Likely cause: {cause}") from error
    # Modes have a modal mass each, and a congruence keeps it: digits of shapes leave none of them without mass.
    return replace(proof.estimated(body), rounding=DOUBLE)


def _spec(modal: ModalBody, face: str, spec: InterfaceSpec) -> InterfaceSpec:
    """An interface by its nodes; ``set`` names one of the file."""
    if spec.set is None:
        return spec
    if spec.set not in modal.sets:
        known = ", ".join(modal.sets) or "none"
        raise SceneError(
            f"body '{modal.name}', interface '{face}': its file has no interface '{spec.set}' (it has: {known}); name "
            "one of them, or a node"
        )
    of_file = modal.sets[spec.set]
    frame = of_file.frame if spec.frame is None else spec.frame
    return InterfaceSpec(of_file.nodes, spec.dofs or of_file.dofs, None, frame)


def _free(modal: ModalBody) -> Rows:
    """Coordinates without stiffness, which are rigid motions."""
    return np.flatnonzero(~modal.K.any(axis=0))


def _scaled(modal: ModalBody, rows: Rows) -> Array:
    """Shapes at rows, each row of unit length: rotations and translations have different units."""
    shapes = modal.shapes[rows]
    return np.asarray(shapes / np.maximum(np.linalg.norm(shapes, axis=1), np.finfo(float).tiny)[:, None])


def _check_independent(modal: ModalBody, rows: Rows) -> None:
    shapes = _scaled(modal, rows)
    if not rows.size:
        return
    still = rows[~modal.shapes[rows].any(axis=1)]
    rank = int((la.svdvals(shapes) > _TOGETHER).sum())
    if rank == rows.size and not still.size:
        return
    named = f"; no mode moves {modal.dofs.labels[still[0]]}" if still.size else ""
    raise MatrixError(
        f"body '{modal.name}': its {modal.shapes.shape[1]} modes move the {rows.size} interface dofs in {rank} "
        f"independent ways only{named}. A joint needs each of them: name fewer with `dofs:`, or reduce the body with "
        "more static shapes (all interfaces among its nodes, no modes taken out)"
    )


def _with_rigid_motions(modal: ModalBody, rows: Rows) -> Rows:
    """Rows, and further ones that hold the rigid motions that these leave free, so that rows show all of them."""
    free = _free(modal)
    if not free.size:
        return rows
    # Motions that no row shows leave the rounding of the others in the shapes.
    least = max(_TOGETHER, _ROUNDINGS * modal.rounding)
    still = la.null_space(_scaled(modal, rows)[:, free], rcond=least) if rows.size else np.eye(free.size)
    if not still.shape[1]:
        return rows
    every = np.arange(len(modal.dofs))
    moved = _scaled(modal, every)[:, free] @ still
    _, R, order = la.qr(moved.T, mode="economic", pivoting=True)
    found = int((abs(R.diagonal()) > least * abs(R.diagonal()).max(initial=0.0)).sum())
    return np.concatenate([rows, order[:found]])


def _change(modal: ModalBody, rows: Rows) -> Array:
    """[A N]: coordinates from the rows, and from coordinates that leave these at rest (m, m)."""
    if not rows.size:
        return np.eye(modal.K.shape[0])
    S = _sizes(modal)
    K, shapes = modal.K * np.outer(S, S), modal.shapes[rows] * S
    size = np.linalg.norm(shapes, axis=1)
    A = la.pinv(shapes / size[:, None]) / size
    N = la.null_space(shapes / size[:, None], rcond=_TOGETHER)
    stiffness, V = la.eigh(N.T @ K @ N)
    # A rigid motion that no node shows has no stiffness here either.
    own = stiffness > _FREE * stiffness.max(initial=0.0)
    A -= N @ (V[:, own] / stiffness[own]) @ (V[:, own].T @ (N.T @ K @ A))
    return np.asarray(S[:, None] * np.hstack([A, N]))


def _energies(modal: ModalBody, full: Array, rows: Rows) -> Array:
    """Energy in K or D of the least amplitudes that move each row by one unit, as a scale of rounding."""
    if not rows.size:
        return np.empty(0)
    S = _sizes(modal)
    A = S[:, None] * la.pinv(modal.shapes[rows] * S)
    return np.asarray(np.einsum("ia,ij,ja->a", abs(A), abs(full), abs(A)))


def _sizes(modal: ModalBody) -> Array:
    """Amplitude of each coordinate with a unit of strain energy; of rigid ones that of the softest mode."""
    K, M = modal.K.diagonal(), modal.M.diagonal()
    stiff, heavy = K > 0, M > 0
    softest = float((K[stiff & heavy] / M[stiff & heavy]).min(initial=np.inf))
    softest = softest if np.isfinite(softest) else 1.0
    energy = np.where(stiff, K, np.where(heavy, softest * M, 1.0))
    return np.asarray(1 / np.sqrt(energy))
