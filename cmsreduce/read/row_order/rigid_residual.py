"""Forces of a stiffness matrix against rigid motion, and the forces that round-off alone may cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import absolute_product, symmetric_product
from cmsreduce.model import (
    ARITHMETIC,
    CONDENSATION,
    DOUBLE,
    PRINTED,
    DofTable,
    FEModel,
    Nodes,
    rigid_body_shapes,
    spread_noise,
)

__all__ = ["RigidResidual", "rigid_residual", "without_idle_turns"]

Array = NDArray[np.float64]

# Each stored entry is wrong by at most its rounding, so each row is wrong by at most rounding * |K| |R|, for either
# order of summation.
_DIGITS = 2 * PRINTED
# Round-off of a place in a coordinate system: three products with the axes, and the origin.
_FRAMES = 4 * DOUBLE
# All three coordinates of a point may be wrong, in the worst direction.
_COORDINATES = 2.0
# The error that explains a force is estimated with this margin. A force of single precision is half its rounding.
_MARGIN = 2.0
# Kinds of errors of K: relative to its entries, or to sqrt(K_ii K_jj).
_CANCELLED = 1
# Places this near to each other, relative to the radius of gyration of the nodes, are those of one mesh, whatever
# digits a deck shows: one that was converted to other units prints more digits than its numbers hold.
_SAME_PLACES = 1e-9
# A body without constraints has these motions, translations first.
_ALL = 6
# Forces that a cause explains are left with so many times their round-off, itself an estimate, and with this share.
_MORE_THAN_ROUNDING, _LEFT = 10.0, 0.1
# Singular values of the motions of constrained dofs below this are round-off of printed coordinates.
_AT_REST = 1e-6


@dataclass(frozen=True, eq=False)
class RigidResidual:
    """K R c for every rigid motion c that the constraints admit.

    Parameters
    ----------
    motions : (6, m) float64
        Admissible motions: translation, rotation times ``length`` about ``centre``.
    length : float
        Radius of gyration of the nodes.
    centre : (3,) float64
        Mean of the nodes that have rows.
    shapes : (n, m) float64
        Displacements R c.
    force : (n, m) float64
        K R c.
    excess : (n,) float64
        Largest ratio of the force to the force that round-off may leave; above 1 the row is in violation.
    relative : (n,) float64
        That force relative to sqrt(K_ii) max_j sqrt(K_jj) |R_j c|.
    allowed : (n,) float64
        Force that round-off may leave there, relative in the same way.
    rounding, noise : float
        Errors of K that explain the forces, as in ``FEModel``: at least the rounding that was given.
    exact : bool
        True if the forces of all six motions vanish with the coordinates as they are, whatever their digits.
    xyz_rounding : float
        Error of the coordinates that explains the forces of rotations, beyond the digits that they show.
    """

    motions: Array
    length: float
    centre: Array
    shapes: Array
    force: Array
    excess: Array
    relative: Array
    allowed: Array
    rounding: float = 0.0
    noise: float = 0.0
    exact: bool = False
    xyz_rounding: float = 0.0

    @property
    def vanishes(self) -> bool:
        """True if no row is in violation."""
        return bool(self.excess.max(initial=0.0) <= 1.0)

    @property
    def worst(self) -> int:
        """Row with the largest excess."""
        return int(self.excess.argmax())

    def explained(self, rows: NDArray[np.bool_], left: Array) -> bool:
        """True if a cause explains the forces of rows (n,), given the forces (k, any) that it leaves on these k.

        Each row is left with no more than round-off, and all together, relative to their round-off, with a small share
        of the forces: a row barely beyond its round-off shows no cause by itself.
        """
        force, excess, rest = abs(self.force[rows]).max(axis=1), self.excess[rows], abs(left).max(axis=1, initial=0.0)
        if (rest * excess > _MORE_THAN_ROUNDING * force).any():
            return False
        share = np.divide(rest * excess, force, out=np.zeros_like(force), where=(rest > 0) & (force > 0))
        return bool(np.linalg.norm(share) <= _LEFT * np.linalg.norm(excess))


def rigid_residual(
    K: sp.csc_array,
    dofs: DofTable,
    nodes: Nodes,
    constrained: DofTable | None,
    rounding: float,
    condensed: bool,
    noise: float = 0.0,
) -> RigidResidual:
    """Apply a stiffness matrix to the rigid motions that leave the constrained dofs at rest.

    Parameters
    ----------
    K : (n, n) sparse array
        Stiffness.
    dofs, nodes : DofTable, Nodes
        Dofs that the rows should have, and the geometry.
    constrained : DofTable, optional
        Dofs without rows that are held at zero.
    rounding : float
        Relative rounding of the entries.
    condensed : bool
        True if K comes from condensation, so that it carries the round-off of a larger matrix.
    noise : float
        Error of K relative to sqrt(K_ii K_jj) that is known of its source.
    """
    moving = dofs.component > 0
    with_rows = np.zeros(len(nodes), dtype=bool)
    with_rows[nodes.index(dofs.node[moving])] = True
    centre = nodes.xyz[with_rows].mean(axis=0)
    arms = np.linalg.norm(nodes.xyz - centre, axis=1)
    length = float(np.sqrt(np.mean(arms**2))) or 1.0
    rigid = _scaled(rigid_body_shapes(dofs, nodes, centre), length)
    motions = _admissible(constrained, nodes, centre, length)
    if motions.shape[1] < _ALL:
        motions = motions @ _seen(rigid @ motions)
    shapes = rigid @ motions
    force = symmetric_product(K)(shapes)
    if not motions.shape[1]:
        zero = np.zeros(len(dofs))
        return RigidResidual(motions, length, centre, shapes, force, zero, zero, zero, rounding)
    own = np.sqrt(np.abs(K.diagonal()))
    scale = own[:, None] * np.max(own[:, None] * np.abs(shapes), axis=0, initial=0.0)
    misplaced = _misplaced(dofs, nodes, arms)
    of_each = absolute_product(K)(np.hstack([np.abs(shapes), misplaced]))
    terms, of_errors = np.hsplit(of_each, [motions.shape[1]])
    turn, reach = np.linalg.norm(motions[3:], axis=0) / length, np.linalg.norm(motions[:3], axis=0)

    def moved(xyz_rounding: float, frame_rounding: float) -> Array:
        """Forces of coordinates and frames of such rounding; both have the round-off of their coordinate systems."""
        skew = frame_rounding + _FRAMES
        by_error = np.vstack([_FRAMES * turn, xyz_rounding * turn, skew * turn, skew * reach])
        return np.asarray(of_errors @ (_COORDINATES * by_error))

    explained = _DIGITS * rounding * terms + moved(0.0, 0.0) + ARITHMETIC * scale
    at = np.abs(force)
    # Coordinates that are printed coarsely resist turning alone, so translations show the errors of K.
    shown = slice(0, 3 if motions.shape[1] == _ALL else None)
    sizes = (terms, scale)
    over = np.maximum(at - explained, 0.0)
    spread = _noise(force, shapes, sizes, dofs, shown) if over.any() else []
    # Where rotations leave no other forces than translations, the coordinates are exact, whatever their digits.
    exact = motions.shape[1] == _ALL and (not over.any() or any((over <= limit).all() for limit, _ in spread))
    if not exact and (nodes.xyz_rounding or nodes.frame_rounding):
        explained += moved(nodes.xyz_rounding, nodes.frame_rounding)
    off = 0.0
    if not exact and motions.shape[1] == _ALL and not over[:, shown].any():
        off = _off_the_mesh(np.maximum(at - explained, 0.0), moved(1.0, 0.0), _SAME_PLACES * length)
        if off:
            explained += moved(off, 0.0)
    limits, known = spread, max(noise, CONDENSATION if condensed else 0.0)
    if (at > explained).any():
        limits.append((_left_out(K, dofs, shapes), _CANCELLED))
        if known:
            limits.append((known * scale, _CANCELLED))
    allowed, rounding, found = _explained(at, explained, sizes, limits, rounding)
    excess = np.divide(at, allowed, out=np.where(at > 0, np.inf, 0.0), where=allowed > 0)
    rows, worst = np.arange(len(dofs)), excess.argmax(axis=1)
    # A row with an empty diagonal has no scale; the forces that should cancel in it give one.
    scale = np.where(scale > 0, scale, terms)
    relative = np.divide(at, scale, out=np.zeros_like(at), where=scale > 0)
    tolerance = np.divide(allowed, scale, out=np.zeros_like(at), where=scale > 0)
    worst_of_row = (excess[rows, worst], relative[rows, worst], tolerance[rows, worst])
    noise = max(noise, found)
    if condensed:
        # Coordinates change the energy of a rigid motion to second order alone: that of a condensed K is its noise.
        energy, parts = (abs(np.einsum("ij,ij->j", *pair)) for pair in ((shapes, force), (np.abs(shapes), terms)))
        share = float(np.divide(energy, parts, out=np.zeros_like(energy), where=parts > 0).max())
        noise = max(noise, min(_MARGIN * share, CONDENSATION))
    return RigidResidual(motions, length, centre, shapes, force, *worst_of_row, rounding, noise, exact, off)


def _off_the_mesh(over: Array, of_one: Array, limit: float) -> float:
    """Error of the coordinates that explains forces, from those of an error of one; 0 if it is beyond a limit."""
    error = _MARGIN * float(np.divide(over, of_one, out=np.where(over > 0, np.inf, 0.0), where=of_one > 0).max())
    return error if error <= limit else 0.0


def _noise(
    force: Array, shapes: Array, sizes: tuple[Array, Array], dofs: DofTable, shown: slice
) -> list[tuple[Array, int]]:
    """Forces that noise spread over the body explains, and the kind of noise; empty if they are not spread."""
    rows = dofs.component > 0
    spread = spread_noise(
        force[rows, shown], tuple(size[rows, shown] for size in sizes), shapes[rows, shown], dofs.node[rows]
    )
    return [] if spread is None else [(spread[0] * sizes[spread[1]], spread[1])]


def _left_out(K: sp.csc_array, dofs: DofTable, shapes: Array) -> Array:
    """Forces of entries that the program left out because they are small, (n, m).

    ANSYS writes no entry below a limit. Such an entry stands between nodes that others couple, and is at most as large
    as the smallest one that was written. Where all entries are large, none was left out for its size.
    """
    least = float(abs(K.data).min(initial=np.inf))
    if least > CONDENSATION * float(abs(K.diagonal()).max(initial=0.0)):
        return np.zeros_like(shapes)
    _, node = np.unique(dofs.node, return_inverse=True)
    rows = np.arange(len(dofs))
    of_node = sp.csr_array((np.ones(rows.size), (node, rows)))
    written = sp.csr_array((np.ones(K.nnz), K.indices, K.indptr), shape=K.shape)
    coupled = of_node @ written @ of_node.T
    coupled.data[:] = 1.0
    all_entries = of_node.T @ (coupled @ (of_node @ np.abs(shapes)))
    forces: Array = least * np.maximum(all_entries - written @ np.abs(shapes), 0.0)
    return forces


def _explained(
    force: Array, explained: Array, sizes: tuple[Array, Array], limits: list[tuple[Array, int]], rounding: float
) -> tuple[Array, float, float]:
    """Forces that errors of K explain, with these errors: of its entries, and relative to sqrt(K_ii K_jj).

    The errors are as large as the forces ask for, if the forces keep within one of the limits.
    """
    over = np.maximum(force - explained, 0.0)
    if not over.any():
        return explained, rounding, 0.0
    for limit, kind in limits:
        if (over <= limit).all():
            level = _MARGIN * float(np.divide(over, sizes[kind], out=np.zeros_like(over), where=over > 0).max())
            allowed = explained + level * sizes[kind]
            return (allowed, rounding, level) if kind == _CANCELLED else (allowed, max(rounding, level), 0.0)
    # Only the forces beyond the noise need another cause.
    return explained + sum((limit for limit, _ in limits), np.zeros_like(force)), rounding, 0.0


def _scaled(R: Array, length: float) -> Array:
    """Rigid shapes with rotations per ``length``, so that all columns are displacements of order one."""
    return np.asarray(R / np.repeat([1.0, length], 3))


def _admissible(constrained: DofTable | None, nodes: Nodes, centre: Array, length: float) -> Array:
    """Rigid motions that leave the constrained dofs at rest, (6, m), orthonormal."""
    if constrained is None:
        return np.eye(6)
    held = (constrained.component > 0) & (nodes.index(constrained.node) >= 0)
    if not held.any():
        return np.eye(6)
    table = DofTable(constrained.node[held], constrained.component[held])
    R = _scaled(rigid_body_shapes(table, nodes, centre), length)
    R[table.component > 3] *= length
    # With six empty rows, fewer than six constraints have a full set of right singular vectors, too.
    _, size, motions = np.linalg.svd(np.vstack([R, np.zeros((6, 6))]), full_matrices=False)
    free: Array = motions[size <= _AT_REST * max(size[0], 1.0)].T
    return free


def _seen(shapes: Array) -> Array:
    """Combinations (m, k) of the motions of some shapes (n, m) that move a row; a plane body has no others to prove."""
    _, size, motions = np.linalg.svd(shapes, full_matrices=False)
    seen: Array = motions[size > _AT_REST * max(float(size.max(initial=0.0)), 1.0)].T
    return seen


def _misplaced(dofs: DofTable, nodes: Nodes, arms: Array) -> Array:
    """Largest error of each dof's displacement by unit errors (n, 4).

    Under a rotation by one: of round-off of a coordinate, relative to it; of a coordinate by one; of a displacement
    frame by one, if it is not along the basic axes. Under a translation by one: of such a frame.
    """
    error = np.zeros((len(dofs), 4))
    moving = np.flatnonzero(dofs.component > 0)
    at, translation = nodes.index(dofs.node[moving]), dofs.component[moving] <= 3
    turned = (np.abs(nodes.frame - np.eye(3)).max(axis=(1, 2), initial=0.0) > 0)[at]
    error[moving, 0] = np.where(translation, np.abs(nodes.xyz).max(axis=1, initial=0.0)[at], 0.0)
    error[moving, 1] = translation
    error[moving, 2] = turned * np.where(translation, arms[at], 1.0)
    error[moving, 3] = turned & translation
    return error


def without_idle_turns(body: FEModel) -> DofTable | None:
    """Constraints without the rotations of nodes that have no rotations among the rows, as decks hold those of solids.

    Nothing turns such a node, so that holding it holds no motion of the body.
    """
    held = body.constrained
    if held is None or not (held.component > 3).any():
        return held
    turned = np.unique(body.dofs.node[body.dofs.component > 3])
    kept = (held.component <= 3) | np.isin(held.node, turned)
    if kept.all():
        return held
    return held[kept] if kept.any() else None
