"""Modes in double precision from a factor in single precision: a rough Krylov space, extended by corrections."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import SearchSpace, column_products, inner, put, symmetric_product, times
from cmsreduce.linalg.eigen.block_lanczos import BlockLanczos, Operator
from cmsreduce.linalg.eigen.inverse_iteration import ShiftedModes, eigen_residuals
from cmsreduce.linalg.sparse import BLOCK, RoughSolve

__all__ = ["corrected_modes"]

Array = NDArray[np.float64]

# Columns of a Lanczos block, and columns of the basis beyond four times the modes sought.
_WIDTH, _MORE = 8, 160
# Relative residual of a Ritz value at which the rough space is good enough; the noise of the solves is not far below.
_ROUGH = 1e-6
# Ritz vectors beyond twice the modes sought. A correction reduces the error of mode i along mode j by lam_i / lam_j, so
# that a larger space converges faster.
_BESIDE = 20
# Ritz vectors that are computed at a time, since the Krylov space is still in memory.
_HANDED = 24
# The search stops after _PATIENCE corrections in a row that do not reduce the worst residual to this share.
_SHRINKS, _PATIENCE = 0.5, 2
_ROUNDS = 12
# Corrections of unit mass whose squared difference is below this are one vector.
_NEW = 1e-10


def corrected_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    rough: RoughSolve,
    high: float,
    wanted: int,
    tolerance: float,
    rigid: Array,
) -> ShiftedModes | None:
    """Lowest modes of a pencil, as many as were counted.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, positive definite except on ``rigid``, and mass.
    rough : RoughSolve
        Solves K x = b (elastic flexibility for a free body) to single precision.
    high : float
        Squared frequency below which the modes were counted.
    wanted : int
        Number of modes counted.
    tolerance : float
        A mode of unit mass is accepted when |K^-1 r|_M, r = K x - lam M x, is below this.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.

    Returns
    -------
    ShiftedModes or None
        None if fewer modes were found, or if corrections no longer reduce the residuals.

    Notes
    -----
    The error of K^-1 in single precision lies along the softest motions. Lanczos finds these first, so a Rayleigh-Ritz
    step with K and M themselves removes most of it; the rest is five digits smaller. The residuals are then solved for
    with the same factor and join the space until it contains the modes (Davidson's method). Source: E. R. Davidson,
    J. Comput. Phys. 17 (1975), 87-94; bound: as in `inverse_iteration.polished`.
    """
    try:
        return _corrected(K, M, rough, high, wanted, tolerance, rigid)
    except la.LinAlgError:
        # Rounding has made vectors of the space linearly dependent.
        return None


def _corrected(
    K: sp.csc_array,
    M: sp.csc_array,
    rough: RoughSolve,
    high: float,
    wanted: int,
    tolerance: float,
    rigid: Array,
) -> ShiftedModes | None:
    stiffness, mass = symmetric_product(K), symmetric_product(M)
    V = SearchSpace(K.shape[0])
    A, B = np.zeros((0, 0)), np.zeros((0, 0))
    for C in _rough_vectors(rough.solve, mass, K.shape[0], wanted, rigid):
        A, B = _extended(V.inner, C, A, B, stiffness, mass)
        V.append(C)
        del C
    if V.m < wanted:
        return None
    worst, stuck = np.inf, 0
    for _ in range(_ROUNDS):
        lam, Z = _ritz(A, B, wanted)
        if lam[-1] > high:
            return None
        X = V.combined(Z)
        C = np.empty(X.shape, order="F")
        for first in range(0, wanted, BLOCK):
            part = slice(first, first + BLOCK)
            put(rough.solve(eigen_residuals(stiffness, mass, X[:, part], lam[part])), C[:, part])
        MC = mass(C)
        # Exact corrections are orthogonal to all modes sought; the other part is noise of the solves.
        residual = np.sqrt(np.maximum(column_products(C, MC) - (inner(X, MC) ** 2).sum(axis=0), 0.0))
        # The relative error of the solves.
        residual /= 1 - rough.contraction
        last, worst = worst, float(residual.max())
        if worst <= tolerance:
            del MC
            # The relative error of 1 / lam, an eigenvalue of K^-1 M, is no larger than the residual.
            return ShiftedModes(*_smoothed(X, C, stiffness, mass), residual / (1 - residual) / 2, True)
        stuck = stuck + 1 if worst > _SHRINKS * last else 0
        if stuck >= _PATIENCE:
            return None
        del X
        inexact = residual > tolerance
        C, A, B = _independent(V, C[:, inexact], MC[:, inexact], A, B, stiffness, mass)
        V.append(C)
        del C, MC
    return None


def _rough_vectors(solve: Operator, mass: Operator, n: int, wanted: int, rigid: Array) -> Iterator[Array]:
    """Ritz vectors (n, q), some at a time, of a Lanczos run with single-precision solves."""
    columns = 4 * wanted + _MORE
    lanczos = BlockLanczos(solve, mass, n, block=_WIDTH, columns=columns, sought=wanted, deflated=rigid)
    while not lanczos.exhausted:
        lanczos.step()
        ritz = lanczos.ritz()
        found = ritz.theta[:wanted]
        settled = found.size == wanted and bool((ritz.residual[:wanted] <= _ROUGH * found).all())
        if settled or lanczos.m + _WIDTH > columns:
            break
    chosen = np.arange(min(2 * wanted + _BESIDE, lanczos.m))
    for first in range(0, chosen.size, _HANDED):
        yield lanczos.vectors(ritz, chosen[first : first + _HANDED])


def _ritz(A: Array, B: Array, wanted: int) -> tuple[Array, Array]:
    """Lowest Ritz values (k,) and coefficients (m, k) of a space with Gram matrices A of K and B of M."""
    scale = 1 / np.sqrt(B.diagonal())
    scales = np.outer(scale, scale)
    lam, Z = la.eigh(A * scales, B * scales, subset_by_index=(0, wanted - 1))
    return lam, scale[:, None] * Z


def _smoothed(X: Array, C: Array, stiffness: Operator, mass: Operator) -> tuple[Array, Array]:
    """Squared frequencies and modes after one inverse iteration, which removes rounding along other modes."""
    X -= C
    A, B = np.zeros((0, 0)), np.zeros((0, 0))
    for first in range(0, X.shape[1], BLOCK):
        A, B = _extended(partial(inner, X[:, :first]), X[:, first : first + BLOCK], A, B, stiffness, mass)
    lam, Z = _ritz(A, B, X.shape[1])
    return lam, times(X, Z)


def _independent(
    V: SearchSpace,
    C: Array,
    MC: Array,
    A: Array,
    B: Array,
    stiffness: Operator,
    mass: Operator,
) -> tuple[Array, Array, Array]:
    """Vectors orthonormal in M that corrections (n, k) add to a space, and the Gram matrices of the extended space."""
    m = V.m
    C = V.taken_from(C, la.solve(B, V.inner(MC), assume_a="pos"))
    A, B = _extended(V.inner, C, A, B, stiffness, mass)
    scale = 1 / np.sqrt(B.diagonal()[m:])
    squared, U = la.eigh(B[m:, m:] * np.outer(scale, scale))
    new = squared > _NEW
    Z = la.block_diag(np.eye(m), (scale[:, None] * U[:, new]) / np.sqrt(squared[new]))
    return np.asarray((Z[m:, m:].T @ C.T).T), Z.T @ A @ Z, Z.T @ B @ Z


def _extended(
    across: Operator,
    C: Array,
    A: Array,
    B: Array,
    stiffness: Operator,
    mass: Operator,
) -> tuple[Array, Array]:
    """Gram matrices of a space extended by vectors C; ``across`` gives inner products with the space."""
    grown = []
    for G, product in ((A, stiffness), (B, mass)):
        P = product(C)
        with_all, own = across(P), inner(C, P)
        grown.append(np.block([[G, with_all], [with_all.T, (own + own.T) / 2]]))
    return grown[0], grown[1]
