"""Integrals of mass and shapes (theory section 8), vibration in a spinning frame from them, and energies of shapes."""

from __future__ import annotations

from itertools import product

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.blocks import column_blocks
from cmsreduce.mechanics.lumped_mass import lumped_mass, moves_generalised, untied_body
from cmsreduce.model import (
    FEModel,
    Lumping,
    Matrix,
    ModalIntegrals,
    SecondOrder,
    cross_matrix,
    each_once,
    mapped_in,
    rigid_body_shapes,
)

__all__ = [
    "CROSS",
    "MassBlocks",
    "energies",
    "mass_and_first_moment",
    "modal_integrals",
    "nodal_motion",
    "rigid_mass",
    "spinning_modes",
]

Array = NDArray[np.float64]

CROSS = np.zeros((3, 3, 3))
"""Components of a vector product: (a x b)_i = CROSS_ijk a_j b_k."""
CROSS[[0, 1, 2], [1, 2, 0], [2, 0, 1]] = 1.0
CROSS[[0, 2, 1], [2, 1, 0], [1, 0, 2]] = -1.0

# Relative to the largest |root|: a smaller damping or growth of a root is round-off of the eigenvalues.
_NEUTRAL = 1e-7
# Columns at once in sums of energies: the products need sixteen bytes an entry.
_BLOCK = 16


def modal_integrals(
    body: FEModel,
    shapes: Array,
    *,
    origin: ArrayLike = (0.0, 0.0, 0.0),
    axes: ArrayLike | None = None,
    lumping: Lumping = "consistent",
    modes: NDArray[np.int64] | None = None,
) -> ModalIntegrals:
    """Integrals over a body and its shapes.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    shapes : (n, k) float64
        Rows along the displacement frames of the nodes.
    origin : (3,) array_like
        Origin of the frame, in basic.
    axes : (3, 3) array_like, optional
        Axes of the frame as rows, in basic; the basic axes if absent.
    lumping : Lumping
        Mass matrix of the integrals.
    modes : (k,) int64, optional
        Columns of the component that the shapes are, for the record; 0 to k - 1 if absent.

    Raises
    ------
    DofMapError
        If the body has no geometry, or no mass that moves along an axis.

    Notes
    -----
    All integrals that are linear in the shapes follow from R^T M R and R^T M phi, R the rigid-body shapes. The others
    need the mass of one direction with the motion of another. Write u, t for translations and rotations of nodes p, q,
    and M_pq, C_pq, J_pq for the 3 x 3 blocks of the mass matrix between translations, from rotations to translations,
    and between rotations. Then, with s_pq the axial vector of C_pq^T, E = tr(J) 1 / 2 - J^T and [t] the matrix of the
    vector product with t,

        int phi phi'^T dm = sum (M_qp u_p) u'_q^T / 2 + u_p (M_pq u'_q)^T / 2 + u_p (C_pq t'_q)^T + (C_pq t_q) u'_p^T
                            + [t_p] E_pq [t'_q]^T,
        int r phi^T dm    = sum r_p (M_pq u_q + C_pq t_q)^T + s_pq u_p^T + E_pq [t_q]^T.

    This is exact if nodes have translations only and M_pq is the same in every direction, as for solids: r is
    interpolated as the displacements are. It is also exact for rigid lumps of mass with any offset and inertia at their
    nodes, and for the bending of straight beams with cubic shapes, in which a rotation moves points beside the node.
    For members that stretch and bend at once, the mean of both interpolations is used. A polar inertia without the
    bending inertia of the same section (Bernoulli beams) is used as given, although no body has such an inertia. For
    any matrix the trace of int phi phi'^T is phi^T M phi', and the skew part of int r phi^T is R^T M phi. Tied nodes
    are integrated at their own places, as before the tie. A direction in which a node is held has no mass.

    Where generalised coordinates carry mass, the matrices hold no such blocks of the whole body. R^T M R, R^T M phi
    and phi^T M phi' are exact there, because the motions of the boundary contain the rigid ones; the integrals of
    second order, but for the trace and the skew part named above, are left undetermined unless the source of the body
    states them.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so there is nothing to integrate over")
    if body.untied_mass is not None:
        as_read, T = untied_body(body)
        modes = np.arange(shapes.shape[1]) if modes is None else modes
        return modal_integrals(as_read, T @ shapes, origin=origin, axes=axes, lumping=lumping, modes=modes)
    origin = np.asarray(origin, dtype=np.float64)
    axes = np.eye(3) if axes is None else np.asarray(axes, dtype=np.float64)
    M = lumped_mass(body, lumping)
    R = rigid_body_shapes(body.dofs, body.nodes, origin) @ la.block_diag(axes.T, axes.T)
    rigid = R.T @ (M @ R)
    mass, first_moment = mass_and_first_moment(body, rigid)
    momentum = (M @ R).T @ shapes
    of_second_order = None
    if body.second_order is not None and lumping == "consistent":
        of_second_order = body.second_order.of(shapes).seen_from(origin, axes, axes.T @ momentum[:3])
    elif not moves_generalised(body):
        of_second_order = _second_order(body, M, shapes, origin, axes, momentum[3:])
    return ModalIntegrals(
        origin=origin,
        axes=axes,
        lumping=lumping,
        mass=mass,
        first_moment=first_moment,
        inertia=np.asarray(rigid[3:, 3:]),
        phi=momentum[:3],
        r_cross_phi=momentum[3:],
        modes=np.arange(shapes.shape[1]) if modes is None else np.asarray(modes, dtype=np.int64),
        second_order=of_second_order,
    )


def _second_order(
    body: FEModel, M: sp.csc_array, shapes: Array, origin: Array, axes: Array, turning: Array
) -> SecondOrder:
    """Integrals of the mass of one direction with the motion of another; ``turning`` is int r x phi dm (3, k)."""
    assert body.nodes is not None
    to_axes = nodal_motion(body, axes)
    at = each_once(body.dofs.node[body.dofs.component > 0])
    r = (body.nodes.xyz[body.nodes.index(at)] - origin) @ axes.T
    nodal = sp.csr_array(to_axes @ M @ to_axes.T)
    pairs, k = MassBlocks(nodal, at.size), shapes.shape[1]

    def nodal_motions(part: slice) -> tuple[Array, Array]:
        u, t = (to_axes @ shapes[:, part]).reshape(2, 3, at.size, part.stop - part.start)
        return u, t

    # Shapes on disk come into memory some at a time.
    parts = [slice(0, k)] if mapped_in(shapes) is None else list(column_blocks(k))
    r_phi, phi_phi = np.empty((3, 3, k)), np.empty((3, 3, k, k))
    for number, a in enumerate(parts):
        u, t = nodal_motions(a)
        r_phi[..., a] = pairs.with_position(r, u, t, turning[:, a])
        phi_phi[..., a, a] = pairs.with_shapes(u, t)
        for b in parts[:number]:
            phi_phi[..., a, b] = pairs.with_shapes(u, t, *nodal_motions(b))
            phi_phi[..., b, a] = phi_phi[..., a, b].transpose(1, 0, 3, 2)
    return SecondOrder(r_phi, phi_phi)


def rigid_mass(body: FEModel, about: ArrayLike = (0.0, 0.0, 0.0), lumping: Lumping = "consistent") -> Array:
    """Rigid mass matrix R^T M R (6, 6) of a body about a point, along the basic axes.

    Raises
    ------
    DofMapError
        If the body has no geometry.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so there is nothing to integrate over")
    R = body.rigid_shapes
    momentum = body.rigid_momentum if lumping == "consistent" else lumped_mass(body, lumping) @ R
    moved = np.eye(6)
    # From the mean of the nodes, where small bodies far from the origin keep their digits.
    moved[:3, 3:] = cross_matrix(about - body.nodes.xyz.mean(axis=0))
    return np.asarray(moved.T @ (R.T @ momentum) @ moved)


def mass_and_first_moment(body: FEModel, rigid: Array) -> tuple[float, Array]:
    """Mass and int r dm (3,) of a body from its rigid mass matrix R^T M R (6, 6)."""
    along = rigid.diagonal()[:3]
    mass = float(along.max(initial=0.0))
    if mass <= 0:
        raise DofMapError(f"body '{body.name}' has no mass that moves along an axis, so it has no centre of mass")
    # A coordinate of the centre follows from the two motions across it; a body held in some directions lacks one.
    across = np.where(along.sum() - along > 0, along.sum() - along, 1.0)
    twice = np.array([rigid[5, 1] - rigid[4, 2], rigid[3, 2] - rigid[5, 0], rigid[4, 0] - rigid[3, 1]])
    return mass, mass * twice / across


def nodal_motion(body: FEModel, axes: Array) -> sp.csr_array:
    """Matrix from rows to translations x y z, then rotations x y z, of all nodes along the axes (6 N, n)."""
    assert body.nodes is not None
    moving = np.flatnonzero(body.dofs.component > 0)
    ids, node = np.unique(body.dofs.node[moving], return_inverse=True)
    component = body.dofs.component[moving].astype(int) - 1
    direction = body.nodes.frame[body.nodes.index(body.dofs.node[moving]), component % 3] @ axes.T
    block = 3 * (component // 3)[:, None] + np.arange(3)
    rows = block * ids.size + node[:, None]
    entries = sp.coo_array((direction.ravel(), (rows.ravel(), np.repeat(moving, 3))), shape=(6 * ids.size, body.n))
    motion = sp.csr_array(entries)
    motion.eliminate_zeros()
    return motion


class MassBlocks:
    """Mass matrix between motions of nodes, in blocks of one direction with another."""

    def __init__(self, nodal: sp.csr_array, count: int) -> None:
        three = 3 * count
        self.count = count
        self.translation = nodal[:three, :three]
        self.coupling = nodal[:three, three:]
        part = [slice(three + i * count, three + (i + 1) * count) for i in range(3)]
        J = [[nodal[part[i], part[j]] for j in range(3)] for i in range(3)]
        half = (J[0][0] + J[1][1] + J[2][2]) * 0.5
        # E of the axes k and m, between nodes.
        self.spread = [[half - J[k][k] if k == m else -J[m][k] for m in range(3)] for k in range(3)]

    def part(self, a: int, b: int) -> sp.csr_array:
        """From rotations about axis b to translations along axis a, between nodes (N, N)."""
        return self.coupling[a * self.count : (a + 1) * self.count, b * self.count : (b + 1) * self.count]

    def _product(self, A: sp.csr_array, motion: Array) -> Array:
        return np.asarray(A @ motion.reshape(3 * self.count, -1)).reshape(motion.shape)

    def with_shapes(self, u: Array, t: Array, v: Array | None = None, s: Array | None = None) -> Array:
        """Integrals of phi_i phi'_j dm (3, 3, k, k') of translations and rotations u, t (3, N, k); of v, s if given."""
        # Each order of the two modes gets half of the work of translations, and all of the work of the coupling.
        if v is None or s is None:
            v, s, one = u, t, self._half(u, u, t)
            found = one + one.transpose(1, 0, 3, 2)
        else:
            found = self._half(u, v, s) + self._half(v, u, t).transpose(1, 0, 3, 2)
        if t.any():
            for k, m in product(range(3), repeat=2):
                E = np.tensordot(t, np.stack([self.spread[k][m] @ part for part in s]), (1, 1))
                found += np.einsum("ic,jd,cadb->ijab", CROSS[:, :, k], CROSS[:, :, m], E, optimize=True)
        return np.asarray(found)

    def _half(self, u: Array, v: Array, s: Array) -> Array:
        """Work of translations u on half the momentum of translations v and the whole momentum of rotations s."""
        half = np.tensordot(u, self._product(self.translation, v) / 2 + self._product(self.coupling, s), (1, 1))
        return np.asarray(half.transpose(0, 2, 1, 3))

    def with_position(self, r: Array, u: Array, t: Array, turning: Array) -> Array:
        """Integrals of r_i phi_j dm (3, 3, k), nodes at r (N, 3); the skew part is ``turning``, int r x phi dm."""
        force = self._product(self.translation, u) + self._product(self.coupling, t)
        found = np.einsum("pi,jpk->ijk", r, force)
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            # Of C = -c [s]x, rows are translations: s_i = (C_ab - C_ba) / 2 of the two other directions.
            arm = self.part(a, b) - self.part(b, a)
            found[i] += np.einsum("p,jpk->jk", np.asarray(arm.sum(axis=1)).ravel() / 2, u)
        if t.any():
            for i, m in product(range(3), repeat=2):
                found[i] += CROSS[:, :, m] @ (np.asarray(self.spread[i][m].sum(axis=0)).ravel() @ t)
        symmetric = (found + found.transpose(1, 0, 2)) / 2
        return np.asarray(symmetric + np.einsum("mij,mk->ijk", CROSS, turning) / 2)


def spinning_modes(K: Array, phi_phi: Array, velocity: Array, stress: Array | None = None) -> tuple[Array, float]:
    """Small vibrations about a body that spins at a steady rate: M q'' + 2 G q' + (K + K_g + C) q = 0.

    Parameters
    ----------
    K : (k, k) float64
        Stiffness of modes that do not move the frame.
    phi_phi : (3, 3, k, k) float64
        int phi_i phi_j dm of the modes; its trace is their mass M, positive definite.
    velocity : (3,) float64
        Angular velocity w in rad per unit of time.
    stress : (k, k) float64, optional
        Geometric stiffness K_g at that velocity; none if absent.

    Returns
    -------
    omega : (f,) float64
        Frequencies in rad per unit of time, as seen in the spinning frame, ascending.
    growth : float
        Fastest growth in 1 per unit of time; 0 if no vibration grows.

    Notes
    -----
    G_ab = int phi_a . (w x phi_b) dm is the Coriolis term, and C_ab = int phi_a . (w w^T - w.w 1) phi_b dm the
    softening by the centrifugal force that grows with the deflection.
    """
    w = np.asarray(velocity, dtype=np.float64)
    M = np.einsum("iiab->ab", phi_phi)
    outward = np.outer(w, w) - w @ w * np.eye(3)
    C = np.einsum("ij,ijab->ab", outward, phi_phi)
    G = np.einsum("ij,ijab->ab", cross_matrix(w), phi_phi)
    k = M.shape[0]
    total = K + C + (0.0 if stress is None else stress)
    L = la.cholesky(M, lower=True)

    def unit_mass(A: Array) -> Array:
        return np.asarray(la.solve_triangular(L, la.solve_triangular(L, A, lower=True).T, lower=True).T)

    A = np.block([[np.zeros((k, k)), np.eye(k)], [-unit_mass(total), -2 * unit_mass(G)]])
    roots = la.eigvals(A)
    top = abs(roots).max(initial=0.0)
    omega = np.sort(roots.imag[roots.imag > _NEUTRAL * top])
    growth = float(roots.real.max(initial=0.0))
    return omega, growth if growth > _NEUTRAL * top else 0.0


def energies(A: Matrix, X: Array) -> Array:
    """x^T A x of each column, summed in extended precision.

    Parameters
    ----------
    A : (n, n) float64 or sparse array
        Symmetric.
    X : (n, k) float64
        Shapes.

    Returns
    -------
    (k,) float64

    Notes
    -----
    The strain energy of a mode of 0.1 Hz is the small difference of terms as large as in a mode of 10 kHz: ten of
    sixteen digits cancel. ``numpy.longdouble`` has three digits more than a double on x86, and the same number where
    the hardware has no wider number.

    Examples
    --------
    >>> energies(np.array([[1e17, -1e17], [-1e17, 1e17 + 64]]), np.ones((2, 1))).tolist()
    [64.0]
    """
    rows = sp.csr_array(A).astype(np.longdouble)
    found = np.empty(X.shape[1])
    for start in range(0, X.shape[1], _BLOCK):
        x = np.asarray(X[:, start : start + _BLOCK], dtype=np.longdouble)
        found[start : start + _BLOCK] = (x * (rows @ x)).sum(axis=0)
    return found
