"""Joined bodies as their modes near a band and the residual flexibility of all other modes.

Within the band, modes that resonate well above it have flexibilities that vary smoothly with frequency, and so do the
joint forces that they alone would transmit. With a, b, c the rows of A, B, C over the modes near the band, Z their
dynamic stiffness and Y the receptance of the residual modes,

    (Z + a^T S a) q = (b^T - a^T S A Y B) u,    S = (A Y A^T)^-1,
    y = (c - C Y A^T S a) q + (C Y B - C Y A^T S A Y B) u,

in which everything but Z is computed at a few Chebyshev points of the band and interpolated: for any number of modes of
the bodies and of joint forces, a frequency costs a solve for the modes near the band. Combinations of these that
resonate well above it once they are joined are eliminated with the residual modes.

Every root of a residual mode is at least 1.5 times the top of the band away from zero. The roots of the joined residual
modes are no nearer: for any shape x the coefficients of x^H (K + i w D - w^2 M) x are sums of those of the modes, none
negative, and its roots are no nearer than the nearest of theirs. Loss factors that differ from mode to mode turn the
stiffness of each by a different angle, and may bring the roots nearer by the root of the cosine of half the largest
difference. The ellipse with foci at both ends of the band [0, top] that reaches to 1.5 top lies within this distance,
and for functions that are analytic there 24 points of the band leave an error of (2 + sqrt(3))^-24 = 2e-14 (Trefethen,
Approximation Theory and Approximation Practice, SIAM 2013, theorem 8.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack, balanced
from cmsreduce.assemble.response.near_modes import eliminated, near_band, split_modes
from cmsreduce.assemble.system import Wiring
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import row_basis
from cmsreduce.linalg.response import frequency_blocks

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
            A = A / _joint_motion(A, stack)[:, None]
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


def _joint_motion(A: Real, stack: PointStack) -> Real:
    """Motion of the bodies at each constraint (c,), each by one unit of kinetic energy; 1 where nothing has mass.

    A joint of a light body is by many decades more flexible than one of heavy bodies. Beside each other in one solve,
    the forces in the latter would lose their digits.
    """
    square = np.zeros(A.shape[0])
    for name, sub in stack.substructures.items():
        motion = A[:, stack.body_columns(name)] @ stack.motions(name)
        if sub.rigid.size:
            # The most flexible motions of a free body, orthonormal in its mass.
            unit = dense(motion @ sub.rigid)
        else:
            mass = sub.M.diagonal()
            unit = dense(motion)[:, mass > 0] / np.sqrt(mass[mass > 0])
        square += (unit**2).sum(axis=1)
    return np.sqrt(np.where(square > 0, square, 1.0))


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
        None where coupling of receptances takes less time, or where it is not clear if the residual modes span a joint.
    """
    if omega.size < _FEWEST_POINTS or joined.c < _FEWEST_FORCES:
        return None
    omega_max, c = float(omega.max()), joined.c
    reach = _BEYOND * omega_max
    near = {name: near_band(sub, reach) for name, sub in stack.substructures.items()}
    # A constraint takes one mode at most.
    if sum(int(np.count_nonzero(own)) for own in near.values()) > 2 * c:
        return None
    split = split_modes(stack, joined.left, joined.right, c, near, omega_max)
    if split is None:
        return None
    modes, far = split
    nodes = (chebyshev.chebpts1(_NODES) + 1) / 2 * omega_max
    within = modes.within(far, reach)
    if within is not None:
        modes = modes.moved(within[0])
    count = len(modes.mass) if within is None else within[1]
    residual = modes.residual(far, far.weights(nodes)) if count <= c else None
    if residual is None:
        return None
    residual, modes = eliminated(modes, residual, nodes, count), modes.first(count)
    return ResidualFlexibility(joined, modes.stiffness, modes.drag, modes.mass, residual, omega_max)


def _interpolation(x: Real) -> Real:
    """Values at x in [0, 1] from those at the Chebyshev points (f, nodes)."""
    nodes = chebyshev.chebpts1(_NODES)
    weights = chebyshev.chebvander(nodes, _NODES - 1) * (2 / _NODES)
    weights[:, 0] /= 2
    return np.asarray(chebyshev.chebvander(2 * x - 1, _NODES - 1) @ weights.T)
