"""Joined bodies as their modes near a band and the residual flexibility of all other modes.

Within the band, modes that resonate well above it have flexibilities that vary smoothly with frequency, and so do the
joint forces that they alone would transmit. With a, b, c the rows of A, B, C over the modes near the band, Z their
dynamic stiffness and Y the receptance of the residual modes,

    (Z + a^T S a) q = (b^T - a^T S A Y B) u,    S = (A Y A^T)^-1,
    y = (c - C Y A^T S a) q + (C Y B - C Y A^T S A Y B) u,

in which everything but Z is computed at a few Chebyshev points of the band and interpolated: for any number of modes of
the bodies and of joint forces, a frequency costs a solve for the modes near the band.

Every root of a residual mode is at least 1.5 times the top of the band away from zero. The roots of the joined residual
modes are no nearer: for any shape x the coefficients of x^H (K + i w D - w^2 M) x are sums of those of the modes, none
negative, and its roots are no nearer than the nearest of theirs. Loss factors that differ from mode to mode turn the
stiffness of each by a different angle, and may bring the roots nearer by the root of the cosine of half the largest
difference. The ellipse with foci at both ends of the band [0, top] that reaches to 1.5 top lies within this distance,
and for functions that are analytic there 24 points of the band leave an error of (2 + sqrt(3))^-24 = 2e-14 (Trefethen,
Approximation Theory and Approximation Practice, SIAM 2013, theorem 8.2).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack, balanced
from cmsreduce.assemble.response.receptance import is_diagonal, modal_weights
from cmsreduce.assemble.system import Wiring, balanced_rigid
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import null_space, row_basis
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import Matrix, Substructure

__all__ = ["JoinedRows", "ResidualFlexibility", "residual_flexibility"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]

# Modes with a root nearer to zero than this many times the top of the band are near it.
_BEYOND = 1.5
_NODES = 24
# For fewer forces or frequencies, coupling of receptances takes no more time: 12 forces and 21 modes near the band take
# the same time either way, 90 forces and 21 modes a sixteenth.
_FEWEST_FORCES = 12
_FEWEST_POINTS = 4 * _NODES
# Least eigenvalue of A Y A^T, scaled to a unit diagonal: below it the residual modes do not span the joints, and S
# would have fewer than six digits. Observed values are 3e-3 and more if they do, and rounding, 1e-16, if they do not.
_SPANNED = 1e-10
# Memory of the matrices of a block of frequencies, which stay in the cache.
_BLOCK_BYTES = 2**22


@dataclass(frozen=True, eq=False)
class JoinedRows:
    """Joints, inputs and outputs of one configuration.

    Parameters
    ----------
    left : (c + displacements + rates, size) float64
        Constraints, then the outputs that are not zero.
    right : (c + inputs, size) float64
        The same constraints, then the inputs.
    c, outputs : int
        Constraints; outputs, including those that are zero.
    displacement, rate : tuple of int
        Outputs of the last rows on the left.
    """

    left: Real
    right: Real
    c: int
    outputs: int
    displacement: tuple[int, ...]
    rate: tuple[int, ...]

    @classmethod
    def of(cls, wiring: Wiring, stack: PointStack | None = None) -> JoinedRows:
        """Collect the rows of a configuration; with a stack, without constraints that are dependent in its motions."""
        # Joints that lock one motion of a reduced body twice would leave lambda undetermined.
        A = wiring.A
        if stack is not None:
            parts = [balanced(A[:, stack.body_columns(name)], stack.motions(name)) for name in stack.substructures]
            A = row_basis(np.hstack(parts)) @ A
        displacement, rate = (np.flatnonzero(rows.any(axis=1)) for rows in (wiring.C1, wiring.C2))
        left = np.vstack([A, wiring.C1[displacement], wiring.C2[rate]])
        measured = tuple(displacement.tolist()), tuple(rate.tolist())
        return cls(left, np.vstack([A, wiring.B]), A.shape[0], wiring.C1.shape[0], *measured)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows on the left and on the right."""
        return self.left.shape[0], self.right.shape[0]

    def response(self, G: Complex, omega: Real) -> Complex:
        """Outputs under unit inputs (f, outputs, inputs), from the flexibility of the bodies between all rows."""
        c = self.c
        both = G[:, c:, c:]
        if c:
            both = both - G[:, c:, :c] @ np.linalg.solve(G[:, :c, :c], G[:, :c, c:])
        return self.measured(both, omega)

    def measured(self, both: Complex | Real, omega: Real) -> Complex:
        """Outputs (f, outputs, inputs) from the motions of the measuring rows: rates are i w times their motions."""
        H = np.zeros((omega.size, self.outputs, both.shape[2]), dtype=np.complex128)
        d = len(self.displacement)
        H[:, self.displacement] = both[:, :d]
        H[:, self.rate] += 1j * omega[:, None, None] * both[:, d:]
        return H


@dataclass(frozen=True, eq=False)
class ResidualFlexibility:
    """Responses of one configuration at any frequencies up to the top of a band.

    Parameters
    ----------
    joined : JoinedRows
        Joints, inputs and outputs.
    stiffness : (k, k) complex128
        K + i loss of the modes near the band.
    drag, mass : (k, k) float64
        Their D and M.
    residual : (nodes, k + rows measured, k + inputs) complex128
        Part of the residual modes at the Chebyshev points of [0, top].
    omega_max : float
        Top of the band in rad/s.
    """

    joined: JoinedRows
    stiffness: Complex
    drag: Real
    mass: Real
    residual: Complex
    omega_max: float

    def __call__(self, omega: Real) -> Complex:
        """Response (f, outputs, inputs) at frequencies (f,) in rad/s, none above the top."""
        k = self.stiffness.shape[0]
        nodes, rows, columns = self.residual.shape
        H = np.empty((omega.size, self.joined.outputs, columns - k), dtype=np.complex128)
        for part in frequency_blocks(omega.size, 3 * 16 * rows * columns, _BLOCK_BYTES):
            w = omega[part, None, None]
            values = _interpolation(omega[part] / self.omega_max) @ self.residual.reshape(nodes, -1).view(np.float64)
            E = values.view(np.complex128).reshape(-1, rows, columns)
            Z = E[:, :k, :k] + self.stiffness + 1j * w * self.drag - w**2 * self.mass
            both = E[:, k:, k:] + E[:, k:, :k] @ np.linalg.solve(Z, E[:, :k, k:])
            H[part] = self.joined.measured(both, omega[part])
        return H


def residual_flexibility(stack: PointStack, joined: JoinedRows, omega: Real) -> ResidualFlexibility | None:
    """Split the modes of joined bodies into those near a band and the residual ones.

    All coordinates of a body that is not in modes count as near.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    joined : JoinedRows
        Joints, inputs and outputs of the configuration.
    omega : (f,) float64
        Circular frequencies in rad/s of the response.

    Returns
    -------
    ResidualFlexibility or None
        None where coupling of receptances takes less time, or where the residual modes do not span the joints.
    """
    if omega.size < _FEWEST_POINTS or joined.c < _FEWEST_FORCES:
        return None
    omega_max, c = float(omega.max()), joined.c
    near = {name: _near(sub, _BEYOND * omega_max) for name, sub in stack.substructures.items()}
    if sum(int(np.count_nonzero(columns)) for columns in near.values()) > c:
        return None
    modes = _near_modes(stack, joined, {name: np.flatnonzero(columns) for name, columns in near.items()})
    far = {name: np.flatnonzero(~columns) for name, columns in near.items()}
    left, right = _over(joined.left, stack, far), _over(joined.right, stack, far)
    k = modes.left.shape[1]
    nodes = (chebyshev.chebpts1(_NODES) + 1) / 2 * omega_max
    weights = [modal_weights(stack.substructures[name], nodes, own) for name, own in far.items() if own.size]
    residual = np.empty((_NODES, left.shape[0] - c + k, right.shape[0] - c + k), dtype=np.complex128)
    for E, weight in zip(residual, np.hstack([np.empty((_NODES, 0)), *weights]), strict=True):
        G = (left * weight) @ right.T
        if not _is_spanned(G[:c, :c]):
            return None
        forces = np.linalg.solve(G[:c, :c], np.hstack([modes.left[:c], G[:c, c:]]))
        E[:k], E[k:] = modes.right[:c].T @ forces, -G[c:, :c] @ forces
        E[:k, k:] = modes.right[c:].T - E[:k, k:]
        E[k:, :k] += modes.left[c:]
        E[k:, k:] += G[c:, c:]
    return ResidualFlexibility(joined, modes.stiffness, modes.drag, modes.mass, residual, omega_max)


class _NearModes(NamedTuple):
    """Rows of the joints and channels over the modes near the band (.., k), and matrices of these (k, k)."""

    left: Real
    right: Real
    stiffness: Complex
    drag: Real
    mass: Real


def _near_modes(stack: PointStack, joined: JoinedRows, columns: Mapping[str, Ints]) -> _NearModes:
    """Modes near the band, beginning with the free rigid motions of the system.

    Joints and stiffness do not act in these: they have inertia alone, which far below the resonances is less than the
    rounding of the stiffness at the joints. Entries that vanish are therefore set to zero.
    """
    c, bodies = joined.c, stack.substructures
    left, right = _over(joined.left, stack, columns), _over(joined.right, stack, columns)
    K, M, D, loss = (
        la.block_diag(*[_part(getattr(sub, letter), columns[name]) for name, sub in bodies.items()])
        for letter in ("K", "M", "D", "loss")
    )
    rigid = balanced_rigid(left[:c], [sub.rigid[columns[name]] for name, sub in bodies.items()])
    free = la.qr(rigid @ null_space(left[:c] @ rigid)[0], mode="economic")[0]
    f = free.shape[1]
    if f:
        T = np.hstack([free, la.qr(M @ free)[0][:, f:]])
        left, right, K, M, D, loss = left @ T, right @ T, *(T.T @ A @ T for A in (K, M, D, loss))
        M[:f, f:] = M[f:, :f] = 0
        for nothing in (left[:c].T, right[:c].T, K, K.T, loss, loss.T):
            nothing[:f] = 0
    return _NearModes(left, right, K + 1j * loss, D, M)


def _near(sub: Substructure, reach: float) -> NDArray[np.bool_]:
    """Mark coordinates with a root m w^2 - i d w - (k + i g) = 0 with ``abs(w) <= reach``, or that are no modes."""
    if not is_diagonal(sub):
        return np.ones(sub.m, dtype=bool)
    m, k, d, g = (np.zeros(sub.m) if A is None else np.asarray(A.diagonal()) for A in (sub.M, sub.K, sub.D, sub.loss))
    stiffness = k + 1j * g
    root = np.sqrt(4 * m * stiffness - d**2)
    # m times the farther root; the nearer one is the product of both divided by it. Without mass there is one root.
    far = np.maximum(abs(1j * d + root), abs(1j * d - root)) / 2
    return np.asarray(abs(stiffness) <= reach * far)


def _over(rows: Real, stack: PointStack, columns: Mapping[str, Ints]) -> Real:
    """Rows over some coordinates of each body, from rows over the motions."""
    parts = [rows[:, stack.body_columns(name)] @ dense(stack.motions(name)[:, own]) for name, own in columns.items()]
    return np.hstack([np.empty((rows.shape[0], 0)), *parts])


def _is_spanned(G: Complex) -> bool:
    size = np.diagonal(G).real
    if not (size > 0).all():
        return False
    root = np.sqrt(size)
    try:
        np.linalg.cholesky(G.real / np.outer(root, root) - _SPANNED * np.eye(root.size))
    except np.linalg.LinAlgError:
        return False
    return True


def _part(A: Matrix | None, own: Ints) -> Real:
    return np.zeros((own.size, own.size)) if A is None else dense(A[own][:, own])


def _interpolation(x: Real) -> Real:
    """Values at x in [0, 1] from those at the Chebyshev points (f, nodes)."""
    nodes = chebyshev.chebpts1(_NODES)
    weights = chebyshev.chebvander(nodes, _NODES - 1) * (2 / _NODES)
    weights[:, 0] /= 2
    return np.asarray(chebyshev.chebvander(2 * x - 1, _NODES - 1) @ weights.T)
