"""Null space of the constraints, and the scale of the coordinates that it joins."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.eigen import DEPENDENT, row_basis
from cmsreduce.model import Matrix, Substructure, is_gyroscopic

__all__ = [
    "ConstraintSpace",
    "congruent_damping",
    "connected_rows",
    "constraint_space",
    "coordinate_scale",
    "without_rounding",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# The null space is held sparse when at least this share of the coordinates is in no constraint.
_MOSTLY_FREE = 0.5
# A weight of a constraint row below this share of the largest one is round-off of a direction cosine.
_NO_WEIGHT = 1e-14
# Rows of the tiles in which a large matrix is transposed: two tiles fit a cache of the second level.
_TILE = 128
# Coordinates with mass whose part in the constraints is below this share of the others' move by rounding alone: a mass
# so small would have ten million times the frequency of the others' stiffness.
_NO_SHARE = 1e-7
# Scales of coordinates that differ by less need no balance: the least mass then keeps eight digits beside the others,
# or thirteen where coordinates are motions of whole bodies. Those of nodes belong to motions of many of them.
_ALIKE, _WHOLE_ALIKE = 1e4, 30.0


@dataclass(frozen=True, eq=False)
class ConstraintSpace:
    """Null space of constraints, T = (1 - V V^T) of the coordinates kept.

    Parameters
    ----------
    V : (n, rank) Matrix
        Each group of joined coordinates has columns of its own; 1 - V V^T is orthogonal and symmetric, and maps as many
        coordinates as there are constraints to the row space of these.
    kept : (n - rank,) int64
        The other coordinates, which are mapped to the null space.
    scale : (n,) float64, optional
        Factors of the rows of T, so that all columns of T / scale are orthonormal; without it T itself is.

    Notes
    -----
    A block reflector: Schreiber and Parlett, SIAM J. Numer. Anal. 25 (1988) 189. V has as many columns as there are
    constraints, so that a projection on T costs n^2 rank and not n^3.
    """

    V: Matrix
    kept: Indices
    scale: Array | None = None

    @cached_property
    def T(self) -> Matrix:
        """Columns T (n, n - rank) that span the null space."""
        if self.scale is None:
            return self._orthonormal
        T = self._orthonormal
        return sp.csc_array(sp.diags_array(self.scale) @ T) if sp.issparse(T) else self.scale[:, None] * np.asarray(T)

    def coordinates(self, X: Array) -> Array:
        """Coordinates of motions X (n, k) that meet the constraints."""
        return np.asarray(self._orthonormal.T @ (X if self.scale is None else X / self.scale[:, None]))

    @cached_property
    def _orthonormal(self) -> Matrix:
        n = self.V.shape[0]
        if sp.issparse(self.V):
            picked = sp.csc_array(sp.eye_array(n, format="csc"))[:, self.kept]
            T = sp.csc_array(picked - self.V @ sp.csr_array(self.V)[self.kept].T)
            T.eliminate_zeros()
            return T
        V = np.asarray(self.V)
        dense = -(V @ V[self.kept].T)
        dense[self.kept, np.arange(self.kept.size)] += 1.0
        return dense

    def congruent(self, blocks: Sequence[Matrix]) -> Matrix:
        """T^T A T of a symmetric A, given by its diagonal blocks (n - rank, n - rank)."""
        A = sp.csc_array(sp.block_diag([sp.csc_array(block) for block in blocks]))
        A = sp.csc_array((A + A.T) * 0.5)
        if self.scale is not None:
            A = sp.csc_array(sp.diags_array(self.scale) @ A @ sp.diags_array(self.scale))
        if sp.issparse(self.V):
            T = self._orthonormal
            small = sp.csc_array(T.T @ A @ T)
            return sp.csc_array((small + small.T) * 0.5)
        V = np.asarray(self.V)
        # One side is multiplied by T itself: products of stiff and soft coordinates are then as small as T makes them.
        AT = sp.csr_array(A) @ np.asarray(self._orthonormal)
        found = V[self.kept] @ -(V.T @ AT)
        found += AT[self.kept]
        _add_transpose(found)
        return np.asarray(found * 0.5)


def congruent_damping(space: ConstraintSpace, blocks: Sequence[Matrix]) -> Matrix:
    """T^T D T of a damping given by its diagonal blocks, whose skew parts are gyroscopic forces."""
    symmetric = space.congruent(blocks)
    if not any(is_gyroscopic(block) for block in blocks):
        return symmetric
    whole = sp.csr_array(sp.block_diag([sp.csr_array(block) for block in blocks]))
    skew = space.T.T @ (sp.csr_array(whole - whole.T) @ space.T) * 0.5
    return sp.csc_array(symmetric + skew) if sp.issparse(symmetric) else np.asarray(symmetric + skew)


def without_rounding(M: Matrix, T: Matrix, A: sp.csr_array, massive: NDArray[np.bool_]) -> Matrix:
    """T^T M T without the mass of joined motions of coordinates that have none.

    Where two static shapes hold each other, the modes beside them move by the rounding of T. The square of it is no
    mass: it has no digit, and beside it none of the others has any.

    Parameters
    ----------
    M : (k, k) Matrix
        Mass of the joined coordinates.
    T : (n, k) Matrix
        Null space of the constraints.
    A : (c, n) sparse array
        Constraints.
    massive : (n,) bool
        Coordinates with mass.
    """
    mass = M.diagonal()
    light = (mass > 0) & (mass < _NO_SHARE**2 * mass.max(initial=0.0))
    if massive.all() or not light.any():
        return M
    size = abs(A).max(axis=1).toarray().ravel()
    weights = sp.csr_array(sp.diags_array(1 / np.where(size > 0, size, 1.0)) @ abs(A))
    with_mass, without = (
        (weights[:, some] @ abs(sp.csr_array(T)[some])).max(axis=0).toarray().ravel() for some in (massive, ~massive)
    )
    rounding = light & (with_mass < _NO_SHARE * without)
    if not rounding.any():
        return M
    kept = sp.diags_array(np.where(rounding, 0.0, 1.0))
    return sp.csc_array(kept @ sp.csc_array(M) @ kept) if sp.issparse(M) else np.asarray(kept @ M @ kept)


def coordinate_scale(substructures: Sequence[Substructure], A: sp.csr_array) -> Array | None:
    """Scale of the stacked coordinates of bodies with which all have masses of one size; None where they nearly have.

    Modes have unit mass, a node of a micromachine 1e-15 kg. In an orthonormal null space over both, the light ones
    would be rounding beside the others.

    Parameters
    ----------
    substructures : sequence of Substructure
        In the order of their coordinates.
    A : (c, n) sparse array
        Constraints.
    """
    scales, largest = [], 0.0
    for sub in substructures:
        mass, stiffness = (np.maximum(getattr(sub, letter).diagonal(), 0.0) for letter in ("M", "K"))
        both = (mass > 0) & (stiffness > 0)
        if both.any():
            # A coordinate of little mass counts by its stiffness.
            mass = np.maximum(mass, stiffness / np.median(stiffness[both] / mass[both]))
        with np.errstate(divide="ignore"):
            scales.append(np.ones(sub.m) if sub.omega is not None else 1 / np.sqrt(mass))
        if sub.interfaces:
            largest = max(largest, float(scales[-1].max(where=np.isfinite(scales[-1]), initial=0.0)))
    scale = np.minimum(np.concatenate(scales), largest or 1.0)
    sizes = [sub.m for sub in substructures]
    follows = np.repeat([not sub.interfaces for sub in substructures], sizes)
    whole = np.repeat([sub.omega is not None or sub.rigid.shape[1] == sub.m for sub in substructures], sizes)
    spreads = ((scale[~follows], _ALIKE), (scale[~follows & whole], _WHOLE_ALIKE))
    if all(own.max(initial=0.0) <= alike * own.min(initial=np.inf) for own, alike in spreads):
        return None
    # Springs and inertias of joints have no interfaces. Each follows the bodies that move it, whatever mass it has: its
    # scale is such that the largest of them moves it by one.
    moved, own = np.zeros(A.shape[0]), np.zeros(scale.size)
    row, column, weight = sp.find(abs(A))
    np.maximum.at(moved, row, weight * np.where(follows, 0.0, scale)[column])
    np.maximum.at(own, column, moved[row] / weight)
    return np.where(follows & (own > 0), own, scale)


def constraint_space(A: sp.csr_array, scale: Array | None = None) -> ConstraintSpace:
    """Find the null space of constraints.

    Parameters
    ----------
    A : (c, n) sparse array
        Dependent rows are allowed.
    scale : (n,) float64, optional
        Factors of the coordinates, from `coordinate_scale`.

    Returns
    -------
    ConstraintSpace
        Dense unless most coordinates are in no constraint.
    """
    n = A.shape[1]
    weights = sp.csr_array(A, copy=True)
    filled = _filled(weights)
    if scale is not None:
        weights = sp.csr_array(weights @ sp.diags_array(scale))
        filled |= _filled(weights)
    weights = weights[filled]
    # Of each row by itself: a lever arm of micrometres stands beside rotations of modes of 1e-15 kg m^2 in another row.
    largest = np.repeat(abs(weights).max(axis=1).toarray().ravel(), np.diff(weights.indptr))
    weights.data = np.where(abs(weights.data) <= _NO_WEIGHT * largest, 0.0, weights.data)
    weights.eliminate_zeros()
    uses = np.diff(sp.csc_array(weights).indptr)
    touched = uses > 0
    # Many dofs are held one by one, as by the ground: 1 - V V^T changes the sign of each.
    alone = np.diff(weights.indptr) == 1
    alone[alone] = uses[weights[alone].indices] == 1
    held = np.asarray(weights[alone].indices, dtype=np.int64)
    rank = held.size
    values, rows, columns, dropped = [np.full(rank, np.sqrt(2.0))], [held], [np.arange(rank)], [held]
    others = weights[~alone]
    for group in connected_rows(others):
        own = others[group]
        at = np.unique(own.indices)
        # Small: locked motions of joints that share coordinates, by these coordinates.
        block = own[:, at].toarray()
        V = _reflector(block / np.linalg.norm(block, axis=1, keepdims=True))
        r = V.shape[1]
        values.append(V.ravel())
        rows.append(np.repeat(at, r))
        columns.append(np.tile(np.arange(rank, rank + r), at.size))
        dropped.append(at[:r])
        rank += r
    kept = np.setdiff1d(np.arange(n), np.concatenate(dropped))
    if not rank:
        return ConstraintSpace(sp.csc_array((n, 0)), kept, scale)
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    V_all = sp.csc_array(sp.coo_array(entries, shape=(n, rank)))
    # Dense only where the reduced coordinates are at most twice those in constraints.
    mostly_free = np.count_nonzero(~touched) >= _MOSTLY_FREE * n
    return ConstraintSpace(V_all if mostly_free else V_all.toarray(), kept, scale)


def _filled(rows: sp.csr_array) -> NDArray[np.bool_]:
    """True for rows that are more than rounding beside the largest one."""
    norms = np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).ravel())
    return np.asarray(norms > DEPENDENT * norms.max(initial=0.0))


def connected_rows(A: Array | sp.csr_array) -> list[Indices]:
    """Group rows that share columns, directly or through others; rows without entries are in no group."""
    weights = sp.csr_array(A)
    c, n = weights.shape
    starts = np.append(weights.indptr, np.full(n, weights.nnz))
    graph = sp.csr_array((np.ones(weights.nnz), c + weights.indices, starts), shape=(c + n, c + n))
    _, label = csgraph.connected_components(graph, directed=False)
    filled = np.flatnonzero(np.diff(weights.indptr))
    if not filled.size:
        return []
    order = filled[np.argsort(label[filled], kind="stable")]
    starts = np.flatnonzero(np.diff(label[order])) + 1
    return [np.asarray(group, dtype=np.int64) for group in np.split(order, starts)]


def _add_transpose(A: Array) -> None:
    """Add its transpose to a square matrix in place, by tiles that stay in the cache."""
    starts = range(0, A.shape[0], _TILE)
    for a in starts:
        for b in starts[a // _TILE :]:
            here, there = np.s_[a : a + _TILE, b : b + _TILE], np.s_[b : b + _TILE, a : a + _TILE]
            both = A[here] + A[there].T
            A[here], A[there] = both, both.T


def _reflector(A: Array) -> Array:
    """V (n, r) with 1 - V V^T orthogonal and its first r columns in the row space of A, of rank r."""
    Q, _ = la.qr((row_basis(A) @ A).T, mode="economic")
    r = Q.shape[1]
    # With the polar factor of the first rows as target, only 1 + S is inverted.
    U, S, Wt = svd(Q[:r])
    X = Q.copy()
    X[:r] += U @ Wt
    return np.asarray(X @ (Wt.T / np.sqrt(1 + S)))
