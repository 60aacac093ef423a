"""What is left of the equation of motion of approximate modes.

Modes made exact: one inverse iteration, the bounds that it proves, and a Rayleigh-Ritz step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import by_rows, inner, less, put, times
from cmsreduce.linalg.eigen.block_lanczos import Operator
from cmsreduce.linalg.eigen.pencil import refine
from cmsreduce.linalg.machine import current_settings, share_rows
from cmsreduce.linalg.sparse import BLOCK

__all__ = [
    "ShiftedModes",
    "eigen_residuals",
    "polished",
    "refined",
]

# Rows that are worked on at a time.
_RESIDUAL_ROWS = 4096


def eigen_residuals(
    stiffness: Operator, mass: Operator, X: NDArray[np.float64], lam: NDArray[np.float64]
) -> NDArray[np.float64]:
    """K x - lam M x of each mode.

    Parameters
    ----------
    stiffness, mass : callable
        Products with K and M.
    X : (n, k) float64
        Modes.
    lam : (k,) float64
        Squared frequencies.

    Returns
    -------
    (n, k) float64
    """
    given = by_rows(X)
    residual, inertia = stiffness(given), mass(given)

    def work(_: int, rows: slice) -> None:
        residual[rows] -= inertia[rows] * lam

    share_rows(X.shape[0], _RESIDUAL_ROWS, work)
    return residual


Array = NDArray[np.float64]

# Rows whose terms are summed up at a time.
_ROWS = 1024


class ShiftedModes(NamedTuple):
    """Modes of a window, ascending.

    Parameters
    ----------
    lam : (k,) float64
        Squared frequencies.
    X : (n, k) float64
        Modes, orthonormal in M.
    bound : (k,) float64
        Relative error of each frequency (not squared) at most.
    complete : bool
        Whether they are all that were counted; if not, they have no shapes.
    """

    lam: Array
    X: Array
    bound: Array
    complete: bool


def polished(
    X: Array,
    theta: Array,
    sigma: float,
    solve: Operator,
    mass: Operator,
    deflated: Array,
) -> ShiftedModes:
    """Modes after one inverse iteration, which smooths them, with the bound that this iteration proves.

    Parameters
    ----------
    X : (n, k) float64
        Ritz vectors, orthonormal in M; overwritten.
    theta : (k,) float64
        Their Ritz values, of (K - sigma M)^-1 M.
    sigma, solve, mass, deflated
        As `modes_about` takes them.

    Returns
    -------
    ShiftedModes

    Notes
    -----
    A X - theta X is the residual of the operator A = (K - sigma M)^-1 M, which is self-adjoint in M: in that norm it
    bounds the distance to an eigenvalue 1 / (lam - sigma) of A.
    """
    k = theta.size
    stiffness, gram, away = np.zeros((k, k)), np.zeros((k, k)), np.empty(k)
    for first in range(0, k, BLOCK):
        part, known = slice(first, min(first + BLOCK, k)), slice(0, min(first + BLOCK, k))
        B = mass(by_rows(X[:, part]))
        Y = solve(B)
        MY = mass(Y)
        squared, energy = _squared_residuals(Y, X[:, part], MY, B, theta[part])
        residual = np.sqrt(np.maximum(squared, 0.0)) / abs(theta[part])
        # Beyond one the residual says nothing; below, the eigenvalue is this far off at most.
        away[part] = np.where(residual < 1, residual / np.maximum(1 - residual, residual), np.inf) / abs(theta[part])
        scale = 1 / np.sqrt(energy)
        put(less(Y, deflated, inner(deflated, MY)), X[:, part], scale)
        # (K - sigma M) Y = M X: no product with K is needed, in whose round-off a low mode would drown.
        gram[known, part] = inner(X[:, known], MY) * scale
        stiffness[known, part] = inner(X[:, known], B) * scale + sigma * gram[known, part]
    stiffness, gram = _mirrored(stiffness), _mirrored(gram)
    mu, Z = la.eigh(gram, stiffness)
    lam, Z = refined(stiffness, gram, 1 / mu[::-1], (Z / np.sqrt(mu))[:, ::-1])
    order = np.argsort(lam, kind="stable")
    ascending = np.argsort(sigma + 1 / theta, kind="stable")
    return ShiftedModes(lam[order], times(X, Z[:, order]), away[ascending] / (2 * lam[order]), True)


def refined(K: Array, M: Array, lam: Array, Z: Array) -> tuple[Array, Array]:
    """Eigenpairs of a small pencil after a step of `refine`, orthonormal to round-off whatever the step was.

    Rounding turns modes of a cluster within it by more than rounding, and a step corrects to first order only.
    """
    lam, Z = refine(K, M, lam, Z)
    return lam, Z - Z @ (Z.T @ M @ Z - np.eye(lam.size)) / 2


def _squared_residuals(Y: Array, X: Array, MY: Array, MX: Array, theta: Array) -> tuple[Array, Array]:
    """Column by column (Y - X theta)^T (MY - MX theta), and Y^T MY.

    Of the residual itself: its square as a difference of squares would be nothing but round-off.
    """
    sums = np.zeros((current_settings().thread_count, 2, theta.size))

    def work(thread: int, rows: slice) -> None:
        y, my = Y[rows], MY[rows]
        sums[thread, 0] += np.einsum("ij,ij->j", y - X[rows] * theta, my - MX[rows] * theta)
        sums[thread, 1] += np.einsum("ij,ij->j", y, my)

    share_rows(X.shape[0], _ROWS, work)
    squared, energy = sums.sum(axis=0)
    return squared, energy


def _mirrored(A: Array) -> Array:
    """Symmetric matrix of an upper triangle."""
    return np.asarray(np.triu(A) + np.triu(A, 1).T)
