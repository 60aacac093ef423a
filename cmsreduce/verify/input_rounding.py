"""Effect of the rounding of a body's files: its rigid motions as far as they are proven, and error bars of modes."""

from __future__ import annotations

import math

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import Product, Rows, column_blocks, entrywise_product
from cmsreduce.model import (
    ARITHMETIC,
    DOUBLE,
    PRINTED,
    FEModel,
    Finding,
    ModalComponent,
    Proof,
    cross_matrix,
    entry_errors,
)
from cmsreduce.verify.body_matrices import mass_rounding
from cmsreduce.verify.mass_properties import rigid_mass_properties

__all__ = [
    "MOMENTUM",
    "RIGID_SHAPES",
    "elastic_momentum",
    "frequency_error_bars",
    "rigid_motions_proof",
    "rigid_shapes",
]

Array = NDArray[np.float64]

MOMENTUM = 1e-8
"""Momentum of an elastic mode of a free body: modes are orthonormal to 1e-10 of their norms, and a body far from its
origin costs two digits."""
RIGID_SHAPES = "rigid motions: stiffness against geometry"
"""Check of the momentum of elastic modes."""
# Rigid modes of a body that is free in all directions.
_FREE = 6
# Coordinates, or displacement frames, may be wrong in two directions.
_PLACES = 2.0
# Deviations of a sum of roundings that it exceeds once in four hundred times.
_DEVIATIONS = 3.0
# Entries times modes up to which repeated numbers are searched for, in a second or two.
_REPEATED = 5e7


def rigid_motions_proof(body: FEModel, rigid: int, shown: int | None) -> Proof:
    """State how the rigid motions of a body were counted, and to how many digits.

    Parameters
    ----------
    body : FEModel
        The body, with the errors of its K.
    rigid : int
        Motions that K does not resist.
    shown : int, optional
        Rigid motions that the proof of the row order found free; None if it proves nothing for this body.
    """
    digits = -math.log10(PRINTED * body.stiffness_rounding)
    if shown is None:
        text = f"K alone leaves {rigid} motions free" if rigid else "K resists every motion"
        # A mechanism has no energy at all; in few digits a soft motion has none, either.
        exact = not rigid or body.stiffness_rounding <= ARITHMETIC
        return Proof("rigid motions", "proven" if exact else "unproven", digits, text)
    if rigid < shown:
        text = f"the geometry leaves {shown} motions free, and K leaves {rigid}"
        return Proof("rigid motions", "refuted", digits, text)
    text = f"{shown} rigid motions by geometry"
    if rigid == shown:
        return Proof("rigid motions", "proven", digits, f"{text}; K resists all others{_errors(body)}")
    more = f"{text}, and {rigid - shown} more that K resists by no more than its rounding"
    return Proof("rigid motions", "proven" if body.stiffness_rounding <= ARITHMETIC else "unproven", digits, more)


def _errors(body: FEModel) -> str:
    """Errors of K beyond double precision, in words."""
    digits = [] if body.rounding <= DOUBLE else [f"entries rounded to {body.rounding:.1e}"]
    noise = [f"noise of {body.noise:.1e} sqrt(K_ii K_jj)"] if body.noise > DOUBLE else []
    return f" ({', '.join(digits + noise)})" if digits or noise else ""


def frequency_error_bars(component: ModalComponent, columns: slice | NDArray[np.int64]) -> Array:
    """Error bars of natural frequencies: how far the rounding of K and M can move them.

    Parameters
    ----------
    component : ModalComponent
        Modes of a body, orthonormal in M.
    columns : slice or (k,) int64
        Its elastic modes in question.

    Returns
    -------
    (k,) float64
        In Hz. The error of a frequency exceeds its bar once in four hundred times.

    Notes
    -----
    First order: d(w^2) = phi^T (dK - w^2 dM) phi. Each number has an error of uniform distribution up to half a unit of
    its last digit; equal numbers of a matrix have equal errors. The parts of an energy may cancel, so that it has fewer
    digits than its matrix: those of the strain energy of soft modes, and of the kinetic energy of condensed masses,
    whose couplings have either sign. Those of M in double precision show nowhere.
    """
    body, omega = component.body, component.omega[columns]
    if not omega.size:
        return np.empty(0)
    Phi = component.Phi[:, columns]
    found = _squared_changes(body.K, body.rounding, body.noise, Phi)
    if (digits := mass_rounding(body)) > DOUBLE:
        found = found + omega**4 * _squared_changes(body.M, digits, 0.0, Phi)
    moved = _DEVIATIONS * np.sqrt(found / 3) + PRINTED * body.stiffness_rounding * omega**2
    return np.asarray(moved / (2 * omega) / (2 * np.pi))


def rigid_shapes(component: ModalComponent) -> tuple[Finding, ...]:
    """Check of the rigid motions of a free body whose rows were proven; nothing for other bodies."""
    body = component.body
    if component.rigid_count != _FREE or body.nodes is None or body.rows_trusted:
        return ()
    return (Finding(RIGID_SHAPES, *elastic_momentum(component)),)


def elastic_momentum(component: ModalComponent) -> tuple[float, float]:
    """Largest momentum of the elastic modes of a free body, and the momentum that the digits of its files allow.

    Parameters
    ----------
    component : ModalComponent
        Modes of a body with geometry, orthonormal in M, six of them rigid.

    Returns
    -------
    found, allowed : float
        About the centre of mass, relative to the root of the mass or of the moment of inertia; of the rigid motion in
        which the first is the largest share of the second.

    Notes
    -----
    Elastic modes are orthogonal in M to the rigid modes Phi_r. For a rigid motion R of the geometry, whose part in
    these is a = Phi_r^T M R, R^T M phi = (K R - K Phi_r a)^T phi / w^2. The first term is the rounding of K: the softer
    a mode, the more momentum it has. The second is what `orthogonality in K` judges. Coordinates that are wrong by d
    give at most d sqrt(m), because modes have unit modal mass.
    """
    body, elastic = component.body, component.Phi[:, component.elastic]
    assert body.nodes is not None
    R, momentum = body.rigid_shapes.copy(), body.rigid_momentum.copy()
    rigid, omega = np.asarray(component.Phi[:, : component.rigid_count]), component.omega[component.elastic]
    # From the mean of the nodes, which may be far from the origin, to the centre of mass.
    to_centre = cross_matrix(rigid_mass_properties(R.T @ momentum).cg)
    for X in (R, momentum):
        X[:, 3:] += X[:, :3] @ to_centre
    root = np.sqrt(np.maximum(np.einsum("ij,ij->j", R, momentum), 0.0))
    moved = np.flatnonzero(root > 0)
    R, momentum = R[:, moved] / root[moved], momentum[:, moved] / root[moved]
    arm = np.where(moved < _FREE // 2, 0.0, root[:3].max() / root[moved])
    found, coupled, squares = np.zeros((3, moved.size))
    for part in column_blocks(omega.size):
        found = np.maximum(found, abs(momentum.T @ elastic[:, part]).max(axis=1))
    if (found <= MOMENTUM).all():
        return float(found.max(initial=0.0)), MOMENTUM
    force = body.K @ (rigid @ (rigid.T @ momentum))
    by_rounding = _squared_errors(body.K, body.rounding, body.noise)[0](R**2)
    for part in column_blocks(omega.size):
        phi = elastic[:, part]
        coupled = np.maximum(coupled, (abs(force.T @ phi) / omega[part] ** 2).max(axis=1))
        # A mirror image has the same error, and so may others: the terms of an element repeat with either sign.
        squares += 8 * np.sum((by_rounding.T @ np.square(phi)) / omega[part] ** 4, axis=1)
    places = _PLACES * (body.nodes.xyz_rounding * arm + body.nodes.frame_rounding)
    allowed = np.maximum(_DEVIATIONS * np.sqrt(squares / 3) + coupled + places, MOMENTUM)
    worst = int(np.argmax(found / allowed))
    return float(found[worst]), float(allowed[worst])


def _squared_changes(A: sp.csc_array, rounding: float, noise: float, Phi: Array) -> Array:
    """Sum of squares of the largest changes of phi^T A phi by the rounding of each number in A, and by noise (k,)."""
    found, left = np.zeros(Phi.shape[1]), rounding
    if A.nnz * found.size <= _REPEATED:
        found, left = _of_repeated(A, rounding, Phi), 0.0
    return found + _of_independent(A, left, noise, Phi) if left or noise else found


def _of_repeated(A: sp.csc_array, rounding: float, Phi: Array) -> Array:
    """Sum of squares of the largest changes of phi^T A phi by each different number in A (k,)."""
    entries = sp.coo_array(sp.triu(A))
    value, at = np.unique(abs(entries.data), return_inverse=True)
    # A number below the diagonal is that above it.
    twice = np.where(entries.row == entries.col, 1.0, 2.0)
    squares, sign = entry_errors(value, rounding) ** 2, twice * np.sign(entries.data)
    shapes = (np.asarray(phi) for phi in Phi.T)
    return np.array(
        [
            squares @ np.bincount(at, sign * phi[entries.row] * phi[entries.col], minlength=value.size) ** 2
            for phi in shapes
        ]
    )


def _of_independent(A: sp.csc_array, rounding: float, noise: float, Phi: Array) -> Array:
    """Sum of squares of the largest changes of phi^T A phi by each entry of A and its mirror image (k,)."""
    product, diagonal = _squared_errors(A, rounding, noise)
    found = np.zeros(Phi.shape[1])
    for part in column_blocks(found.size):
        # By rows, as the product reads and writes them.
        phi = np.square(Phi[:, part], order="C")
        # Twice each pair of entries, and once the diagonal.
        found[part] = 2 * np.einsum("ij,ij->j", phi, product(phi)) - diagonal @ np.square(phi, out=phi)
    return found


def _squared_errors(K: sp.csc_array, rounding: float, noise: float) -> tuple[Product, Array]:
    """Product of the squares of the largest errors of the entries of K with blocks of vectors, and their diagonal (n,).

    The errors are relative to the entries, and to sqrt(K_ii K_jj) along a row.
    """
    size: Array = abs(K.diagonal())
    own = np.sqrt(size)
    # The noise of a row is the sum of those of its entries.
    per_entry = noise * own / np.sqrt(np.maximum(np.diff(K.indptr), 1))

    def entries(part: Rows, rows: slice) -> Array:
        errors = entry_errors(part.data, rounding)
        if noise > 0:
            of_row = np.repeat(own[rows], np.diff(part.indptr))
            np.maximum(errors, per_entry[part.indices] * of_row, out=errors)
        return np.square(errors, out=errors)

    diagonal = np.maximum(entry_errors(size, rounding), per_entry * own)
    return entrywise_product(K, entries), np.square(diagonal)
