"""Joined bodies split into their modes near a band and the residual ones, and the modes of the joined system near it.

A joint that no residual mode moves, such as the ground of a rigid body, is a constraint of the modes near the band. One
that they move is eliminated by its forces, and what this leaves depends on the frequency smoothly. Most bodies bring
their rigid motions to the modes near the band, and joints leave few of these free: the others move as the joints give
way, far above the band. They are eliminated, too, where this is smooth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.response.by_modes import is_diagonal
from cmsreduce.assemble.system import balanced_rigid
from cmsreduce.linalg.blocks import dense, svd
from cmsreduce.linalg.eigen import null_space
from cmsreduce.model import Matrix, Substructure, is_gyroscopic

__all__ = ["FarModes", "NearModes", "eliminated", "near_band", "split_modes"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Ints = NDArray[np.int64]

# Least eigenvalue of A Y A^T, scaled to a unit diagonal: below it the residual modes do not span the joints, and S
# would have fewer than six digits. Observed values are 3e-3 and more if they do, and rounding, 1e-16, if they do not.
_SPANNED = 1e-10
# The same for joints that they do not move at all; a joint between both is left to its forces.
_UNMOVED = 1e-24
# Joints that move this little beside the motion of the modes near the band are not moved: a share of the amplitude.
_RIGID = 1e-10
# A joint between this and that is left to its forces, too: beside a stiffness that is larger by the square, the modes
# near the band would lose half their digits.
_MOVED = 1e-4
# Constraints of the modes near the band are independent, as all constraints are; less than this is a doubt.
_INDEPENDENT = 1e-9


class FarModes(NamedTuple):
    """Residual modes: their rows of the joints, outputs and inputs (.., n), and their diagonal matrices (n,)."""

    joints: Real
    outputs: Real
    inputs: Real
    stiffness: Complex
    drag: Real
    mass: Real

    def weights(self, omega: Real) -> Complex:
        """Amplitudes under unit modal forces (f, n)."""
        w = omega[:, None]
        return np.asarray(1 / (self.stiffness + 1j * w * self.drag - w**2 * self.mass))

    def combined(self, U: Real) -> FarModes:
        """The same with combinations U (c', c) of the joints."""
        return self._replace(joints=U @ self.joints)


class NearModes(NamedTuple):
    """Modes near the band: their rows of the joints, outputs and inputs (.., k), and matrices of these (k, k).

    The first ``free`` coordinates are the free rigid motions of the system, in which no joint and no stiffness acts.
    """

    joints: Real
    outputs: Real
    inputs: Real
    stiffness: Complex
    drag: Real
    mass: Real
    free: int

    def moved(self, T: Real) -> NearModes:
        """The same in coordinates x = T y."""
        rows = (self.joints @ T, self.outputs @ T, self.inputs @ T)
        return NearModes(*rows, T.T @ self.stiffness @ T, T.T @ self.drag @ T, T.T @ self.mass @ T, self.free)

    def dynamic_stiffness(self, omega: Real) -> Complex:
        """Stiffness (f, k, k), without that of the residual modes."""
        w = omega[:, None, None]
        return np.asarray(self.stiffness + 1j * w * self.drag - w**2 * self.mass)

    def residual(self, far: FarModes, weights: Real | Complex) -> Complex | None:
        """Part of the residual modes in the equations of these, from their amplitudes under unit forces (f, n).

        Returns
        -------
        (f, k + outputs, k + inputs) complex128 or None
            None where the residual modes do not span the joints.
        """
        c, k = self.joints.shape
        left, right = np.vstack([far.joints, far.outputs]), np.vstack([far.joints, far.inputs])
        found = np.empty((len(weights), left.shape[0] - c + k, right.shape[0] - c + k), dtype=np.complex128)
        for E, weight in zip(found, weights, strict=True):
            G = (left * weight) @ right.T
            if not _is_spanned(G[:c, :c]):
                return None
            forces = np.linalg.solve(G[:c, :c], np.hstack([self.joints, G[:c, c:]]))
            E[:k], E[k:] = self.joints.T @ forces, -G[c:, :c] @ forces
            E[:k, k:] = self.inputs.T - E[:k, k:]
            E[k:, :k] += self.outputs
            E[k:, k:] += G[c:, c:]
        return found

    def constrained(self, locks: Real) -> NearModes | None:
        """The same modes under constraints (r, k) that hold no free motion; None if these are not independent."""
        f, r = self.free, len(locks)
        Q, R = la.qr(locks[:, f:].T)
        size = abs(np.diagonal(R))
        if r > R.shape[0] or size.min(initial=1.0) <= _INDEPENDENT * size.max(initial=0.0):
            return None
        return self.moved(la.block_diag(np.eye(f), Q[:, r:]))

    def scaled(self, omega: float) -> NearModes:
        """The same in coordinates whose dynamic stiffness is of one size at a frequency in rad/s."""
        size = (abs(self.stiffness) + omega * abs(self.drag) + omega**2 * abs(self.mass)).diagonal()
        return self.moved(np.diag(omega / np.sqrt(np.where(size > 0, size, omega**2))))

    def within(self, far: FarModes, reach: float) -> tuple[Real, int] | None:
        """Combinations of these modes, of which the last have no root nearer to zero than ``reach`` when joined.

        Returns
        -------
        T : (k, k) float64
            Orthogonal.
        count : int
            Number of the others.

        Notes
        -----
        No root of m s^2 + d s + k is nearer to zero than r if k - r^2 m and k - r d + r^2 m are positive (Jury's
        conditions), as they are for each residual mode at ``reach``. Both are sums over the modes: they are positive
        for all shapes of the residual modes and of these combinations if the matrices of these are so, with the forces
        of the joints. None where a loss factor spoils that of a residual mode, or damping is gyroscopic.
        """
        f, n, k = self.free, len(self.mass), abs(far.stiffness)
        positive = np.array([k - reach**2 * far.mass, k - reach * far.drag + reach**2 * far.mass])
        if not (positive > 0).all() or is_gyroscopic(self.drag):
            return None
        found = self.residual(far, 1 / positive)
        if found is None:
            return None
        K, M, D = (A[f:, f:] for A in (self.stiffness.real, self.mass, self.drag))
        first, T = np.empty((n - f, 0)), np.eye(n - f)
        for E, own in zip(found.real, (K - reach**2 * M, K - reach * D + reach**2 * M), strict=True):
            lam, V = la.eigh(T.T @ (E[f:n, f:n] + own) @ T)
            first, T = np.hstack([first, T @ V[:, lam <= 0]]), T @ V[:, lam > 0]
        return la.block_diag(np.eye(f), np.hstack([first, T])), f + first.shape[1]

    def first(self, count: int) -> NearModes:
        """The first modes alone."""
        return self.moved(np.eye(len(self.mass), count))


def eliminated(modes: NearModes, residual: Complex, omega: Real, count: int) -> Complex:
    """Part of the residual modes in the equations of the first modes, with all others eliminated.

    Parameters
    ----------
    modes : NearModes
    residual : (f, k + outputs, k + inputs) complex128
        That in the equations of all of them at frequencies ``omega`` (f,).
    count : int
        Modes that are left.

    Returns
    -------
    (f, count + outputs, count + inputs) complex128
    """
    k, Z = len(modes.mass), residual.copy()
    Z[:, :k, :k] += modes.dynamic_stiffness(omega)
    here, there = np.arange(Z.shape[1]), np.arange(Z.shape[2])
    rows, columns = (np.concatenate([own[:count], own[k:]]) for own in (here, there))
    X = np.linalg.solve(Z[:, count:k, count:k], Z[:, count:k, columns])
    # The equations of motion are Z q = E u, the outputs E q + E u.
    sign = np.full((rows.size, columns.size), -1.0)
    sign[count:, count:] = 1.0
    return np.asarray(residual[:, rows[:, None], columns] + sign * (Z[:, rows, count:k] @ X))


def split_modes(
    stack: PointStack, left: Real, right: Real, c: int, near: Mapping[str, NDArray[np.bool_]], omega: float
) -> tuple[NearModes, FarModes] | None:
    """Split the modes of joined bodies; joints that the residual modes do not move constrain the others.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    left, right : (c + outputs, size), (c + inputs, size) float64
        Independent joints, then outputs or inputs, over the motions of the points.
    c : int
        Number of joints.
    near : mapping of body to (m_i,) bool
        Modes near the band; all others are uncoupled.
    omega : float
        Top of the band in rad/s.

    Returns
    -------
    (NearModes, FarModes) or None
        None where it is not clear if the residual modes move a joint.
    """
    modes = _near_modes(stack, left, right, c, {name: np.flatnonzero(own) for name, own in near.items()})
    columns = {name: np.flatnonzero(~own) for name, own in near.items()}
    rows, others = _over(left, stack, columns), _over(right, stack, columns)
    bodies = stack.substructures
    k, m, d, g = (
        np.concatenate([np.empty(0), *(_diagonal(getattr(sub, letter), columns[name]) for name, sub in bodies.items())])
        for letter in ("K", "M", "D", "loss")
    )
    far = FarModes(rows[:c], rows[c:], others[c:], k + 1j * g, d, m)
    modes = modes.scaled(omega)
    flexible = far.joints / np.sqrt(abs(far.stiffness))
    size, beside = np.linalg.norm(flexible, axis=1), np.linalg.norm(modes.joints, axis=1) / omega
    unmoved = size <= _RIGID * beside
    if (~unmoved & (size < _MOVED * beside)).any():
        return None
    flexible[unmoved] = 0.0
    scale = 1 / np.where(unmoved, np.where(beside > 0, beside, 1.0), size)
    # Of the triangle, which has at most c rows: the modes may be thousands.
    U, s, _ = svd(la.qr((flexible * scale[:, None]).T, mode="r")[0][:c].T)
    spanned = np.concatenate([s, np.zeros(c - s.size)]) ** 2
    if spanned.min(initial=1.0) > _SPANNED:
        # Independent joints are not mixed: those of light bodies keep their digits.
        return modes, far
    if ((spanned > _UNMOVED) & (spanned <= _SPANNED)).any():
        return None
    U = (U * scale[:, None]).T
    held = modes.constrained(U[spanned <= _UNMOVED] @ modes.joints)
    if held is None:
        return None
    U = U[spanned > _SPANNED]
    return held._replace(joints=U @ held.joints), far.combined(U * ~unmoved)


def near_band(sub: Substructure, reach: float) -> NDArray[np.bool_]:
    """Mark coordinates with a root m w^2 - i d w - (k + i g) = 0 with ``abs(w) <= reach``, or that are no modes."""
    if not is_diagonal(sub):
        return np.ones(sub.m, dtype=bool)
    m, k, d, g = (np.zeros(sub.m) if A is None else np.asarray(A.diagonal()) for A in (sub.M, sub.K, sub.D, sub.loss))
    stiffness = k + 1j * g
    root = np.sqrt(4 * m * stiffness - d**2)
    # m times the farther root; the nearer one is the product of both divided by it. Without mass there is one root.
    far = np.maximum(abs(1j * d + root), abs(1j * d - root)) / 2
    return np.asarray(abs(stiffness) <= reach * far)


def _near_modes(stack: PointStack, left: Real, right: Real, c: int, columns: Mapping[str, Ints]) -> NearModes:
    """Modes near the band, beginning with the free rigid motions of the system.

    Joints and stiffness do not act in these: they have inertia alone, which far below the resonances is less than the
    rounding of the stiffness at the joints. Entries that vanish are therefore set to zero.
    """
    bodies = stack.substructures
    left, right = _over(left, stack, columns), _over(right, stack, columns)
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
    return NearModes(left[:c], left[c:], right[c:], K + 1j * loss, D, M, f)


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


def _diagonal(A: Matrix | None, own: Ints) -> Real:
    return np.zeros(own.size) if A is None else np.asarray(A.diagonal())[own]


def _part(A: Matrix | None, own: Ints) -> Real:
    return np.zeros((own.size, own.size)) if A is None else dense(A[own][:, own])
