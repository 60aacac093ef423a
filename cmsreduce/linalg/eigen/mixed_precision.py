"""Modes to double precision from a factor in single precision: a rough Krylov space, corrected by residuals."""

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
from cmsreduce.linalg.sparse import BLOCK, RefinedFactor

__all__ = ["corrected_modes"]

# Columns of a Lanczos block, and of the basis beyond four times the modes sought.
_WIDTH, _MORE = 8, 160
# Residual of a Ritz value, relative to it, at which the rough space is good enough: below is the noise of the solves.
_ROUGH = 1e-6
# Ritz vectors beside those sought: a correction shrinks what lies along a mode of lam_j by lam_i / lam_j, so that what
# remains in the space is better held there.
_BESIDE = 20
# Ritz vectors that are handed on at a time, while the Krylov space is still in memory.
_HANDED = 24
# A correction has to shrink the worst residual to this share; two in a row that do not are the last.
_SHRINKS, _PATIENCE = 0.5, 2
_ROUNDS = 12
# Directions of corrections that differ by less than this, squared, are one.
_NEW = 1e-10


def corrected_modes(
    K: sp.csc_array, M: sp.csc_array, factor: RefinedFactor, high: float, wanted: int, tolerance: float
) -> ShiftedModes | None:
    """Lowest modes of a pencil, as many as were counted.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, positive definite, and mass.
    factor : RefinedFactor
        Of K, in single precision.
    high : float
        Squared frequency below which the modes were counted.
    wanted : int
        Their number.
    tolerance : float
        |K^-1 r|_M of a mode of unit mass, r = K x - lam M x, at which it is found.

    Returns
    -------
    ShiftedModes or None
        None if fewer were found, or corrections no longer help.

    Notes
    -----
    What single precision takes from K^-1 lies along the softest motions. They are the first that Lanczos finds, so
    that a Rayleigh-Ritz step with the matrices themselves gives them back; what is left is five digits smaller, and
    residuals, solved for by the same factor, join the space until it holds the modes: Davidson's method. Source: E. R.
    Davidson, J. Comput. Phys. 17 (1975), 87-94; bound: as in `inverse_iteration.polished`.
    """
    try:
        return _corrected(K, M, factor, high, wanted, tolerance)
    except la.LinAlgError:
        # Rounding made directions of the space depend on each other.
        return None


def _corrected(
    K: sp.csc_array, M: sp.csc_array, factor: RefinedFactor, high: float, wanted: int, tolerance: float
) -> ShiftedModes | None:
    stiffness, mass = symmetric_product(K), symmetric_product(M)
    V = SearchSpace(K.shape[0])
    A, B = np.zeros((0, 0)), np.zeros((0, 0))
    for C in _rough_vectors(factor, mass, K.shape[0], wanted):
        A, B = _joined(V.inner, C, A, B, stiffness, mass)
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
        C = _corrections(factor, X, lam, stiffness, mass)
        MC = mass(C)
        # Exact corrections are orthogonal to all modes sought; what is not is the noise of the solves.
        along = inner(X, MC)
        residual = np.sqrt(np.maximum(column_products(C, MC) - (along**2).sum(axis=0), 0.0))
        # The solves are off by this share themselves.
        residual /= 1 - factor.contraction
        last, worst = worst, float(residual.max())
        if worst <= tolerance:
            del MC
            # As an eigenvalue of K^-1 M, 1 / lam is this share of itself off at most.
            return ShiftedModes(*_smoothed(X, C, stiffness, mass), residual / (1 - residual) / 2, True)
        stuck = stuck + 1 if worst > _SHRINKS * last else 0
        if stuck >= _PATIENCE:
            return None
        del X
        opened = residual > tolerance
        C, A, B = _widened(V, C[:, opened], MC[:, opened], A, B, stiffness, mass)
        V.append(C)
        del C, MC
    return None


def _rough_vectors(factor: RefinedFactor, mass: Operator, n: int, wanted: int) -> Iterator[NDArray[np.float64]]:
    """Ritz vectors (n, q), some at a time, of a Lanczos run that takes single-precision solves for exact ones."""
    columns = 4 * wanted + _MORE
    lanczos = BlockLanczos(factor.rough, mass, n, block=_WIDTH, columns=columns, sought=wanted)
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


def _ritz(
    A: NDArray[np.float64], B: NDArray[np.float64], wanted: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest Ritz values (k,) and coefficients (m, k) of a space with Gram matrices A of K and B of M."""
    scale = 1 / np.sqrt(B.diagonal())
    ends = (0, wanted - 1)
    lam, Z = la.eigh(A * np.outer(scale, scale), B * np.outer(scale, scale), subset_by_index=ends)
    return lam, scale[:, None] * Z


def _corrections(
    factor: RefinedFactor, X: NDArray[np.float64], lam: NDArray[np.float64], stiffness: Operator, mass: Operator
) -> NDArray[np.float64]:
    """K^-1 (K x - lam M x) of modes, in single precision (n, k)."""
    C = np.empty(X.shape, order="F")
    for first in range(0, lam.size, BLOCK):
        part = slice(first, first + BLOCK)
        put(factor.rough(eigen_residuals(stiffness, mass, X[:, part], lam[part])), C[:, part])
    return C


def _smoothed(
    X: NDArray[np.float64], C: NDArray[np.float64], stiffness: Operator, mass: Operator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequencies and modes after one inverse iteration, which takes out of them what rounding left at all others."""
    X -= C
    A, B = np.zeros((0, 0)), np.zeros((0, 0))
    for first in range(0, X.shape[1], BLOCK):
        A, B = _joined(partial(inner, X[:, :first]), X[:, first : first + BLOCK], A, B, stiffness, mass)
    lam, Z = _ritz(A, B, X.shape[1])
    return lam, times(X, Z)


def _widened(
    V: SearchSpace,
    C: NDArray[np.float64],
    MC: NDArray[np.float64],
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    stiffness: Operator,
    mass: Operator,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Directions of unit mass that corrections (n, k) add to a space, and its Gram matrices with them."""
    m = V.m
    C = V.taken_from(C, la.solve(B, V.inner(MC), assume_a="pos"))
    A, B = _joined(V.inner, C, A, B, stiffness, mass)
    scale = 1 / np.sqrt(B.diagonal()[m:])
    squared, U = la.eigh(B[m:, m:] * np.outer(scale, scale))
    new = squared > _NEW
    Z = la.block_diag(np.eye(m), (scale[:, None] * U[:, new]) / np.sqrt(squared[new]))
    return np.asarray((Z[m:, m:].T @ C.T).T), Z.T @ A @ Z, Z.T @ B @ Z


def _joined(
    across: Operator,
    C: NDArray[np.float64],
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    stiffness: Operator,
    mass: Operator,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gram matrices of a space and of what joins it, whose inner products with it are ``across``."""
    grown = []
    for G, product in ((A, stiffness), (B, mass)):
        P = product(C)
        with_all, own = across(P), inner(C, P)
        grown.append(np.block([[G, with_all], [with_all.T, (own + own.T) / 2]]))
    return grown[0], grown[1]
