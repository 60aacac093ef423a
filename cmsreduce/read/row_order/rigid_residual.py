"""Forces of a stiffness matrix against rigid motion, and the forces that round-off alone may cause."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import DofTable, Nodes, rigid_body_shapes

__all__ = ["RigidResidual", "rigid_residual"]

# Each stored entry is wrong by at most its rounding, so each row is wrong by at most rounding * |K| |R|. The factor is
# ten for the spread between a leading 1 and a leading 9 of printed digits, times two for the order of summation.
_DIGITS = 20.0
# All three coordinates of a point may be wrong, in the worst direction.
_COORDINATES = 2.0
# Round-off of assembly, relative to sqrt(K_ii K_jj), which bounds every entry of a semidefinite matrix and is
# the form of the error bound of Cholesky factorisation (Higham, Accuracy and Stability, theorem 10.3).
_ARITHMETIC = 200 * 2.0**-53
# Static condensation of a slender body subtracts entries that are up to 1e6 times the result (EA/h against EI/L^3).
_CONDENSATION = 1e-9
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
    """

    motions: NDArray[np.float64]
    length: float
    centre: NDArray[np.float64]
    shapes: NDArray[np.float64]
    force: NDArray[np.float64]
    excess: NDArray[np.float64]
    relative: NDArray[np.float64]
    allowed: NDArray[np.float64]

    @property
    def vanishes(self) -> bool:
        """True if no row is in violation."""
        return bool(self.excess.max(initial=0.0) <= 1.0)

    @property
    def worst(self) -> int:
        """Row with the largest excess."""
        return int(self.excess.argmax())


def rigid_residual(
    K: sp.csc_array, dofs: DofTable, nodes: Nodes, constrained: DofTable | None, rounding: float, condensed: bool
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
    """
    moving = dofs.component > 0
    centre = nodes.xyz[np.unique(nodes.index(dofs.node[moving]))].mean(axis=0)
    arms = np.linalg.norm(nodes.xyz - centre, axis=1)
    length = float(np.sqrt(np.mean(arms**2))) or 1.0
    motions = _admissible(constrained, nodes, centre, length)
    shapes = _scaled(rigid_body_shapes(dofs, nodes, centre), length) @ motions
    force = np.asarray(K @ shapes)
    size = abs(K)
    own = np.sqrt(np.abs(K.diagonal()))
    scale = own[:, None] * np.max(own[:, None] * np.abs(shapes), axis=0, initial=0.0)
    allowed = (
        _DIGITS * rounding * (size @ np.abs(shapes))
        + _COORDINATES * (size @ _displacement_error(dofs, nodes, motions, arms, length))
        + (_CONDENSATION if condensed else _ARITHMETIC) * scale
    )
    if not motions.shape[1]:
        zero = np.zeros(len(dofs))
        return RigidResidual(motions, length, centre, shapes, force, zero, zero, zero)
    at = np.abs(force)
    excess = np.divide(at, allowed, out=np.where(at > 0, np.inf, 0.0), where=allowed > 0)
    rows, worst = np.arange(len(dofs)), excess.argmax(axis=1)
    # A row with an empty diagonal has no scale; the forces that should cancel in it give one.
    scale = np.where(scale > 0, scale, size @ np.abs(shapes))
    relative = np.divide(at, scale, out=np.zeros_like(at), where=scale > 0)
    tolerance = np.divide(allowed, scale, out=np.zeros_like(at), where=scale > 0)
    return RigidResidual(
        motions, length, centre, shapes, force, excess[rows, worst], relative[rows, worst], tolerance[rows, worst]
    )


def _scaled(R: NDArray[np.float64], length: float) -> NDArray[np.float64]:
    """Rigid shapes with rotations per ``length``, so that all columns are displacements of order one."""
    return np.asarray(R / np.repeat([1.0, length], 3))


def _admissible(
    constrained: DofTable | None, nodes: Nodes, centre: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
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
    free: NDArray[np.float64] = motions[size <= _AT_REST * max(size[0], 1.0)].T
    return free


def _displacement_error(
    dofs: DofTable, nodes: Nodes, motions: NDArray[np.float64], arms: NDArray[np.float64], length: float
) -> NDArray[np.float64]:
    """Largest error of each dof's displacement that comes from printed coordinates and frames, (n, m)."""
    turn = np.linalg.norm(motions[3:], axis=0) / length
    error = np.zeros((len(dofs), motions.shape[1]))
    moving = np.flatnonzero(dofs.component > 0)
    at = nodes.index(dofs.node[moving])
    # Coordinates also have the round-off of the coordinate systems in which they were given.
    off = nodes.xyz_rounding + 4 * 2.0**-53 * np.abs(nodes.xyz[at]).max(axis=1, initial=0.0)
    turned = np.where(np.abs(nodes.frame[at] - np.eye(3)).max(axis=(1, 2), initial=0.0) > 0, 1.0, 0.0)
    skew = turned * (nodes.frame_rounding + 4 * 2.0**-53)
    reach = np.linalg.norm(motions[:3], axis=0) + turn * arms[at][:, None]
    translation = (dofs.component[moving] <= 3)[:, None]
    error[moving] = np.where(translation, off[:, None] * turn + skew[:, None] * reach, skew[:, None] * turn)
    return error
