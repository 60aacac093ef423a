"""Residuals of approximate modes, and one inverse iteration that improves the modes and bounds their errors."""

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

__all__ = ["ShiftedModes", "eigen_residuals", "polished", "refined_orthonormal"]

Array = NDArray[np.float64]

# Rows that a thread subtracts, or sums up, at a time.
_RESIDUAL_ROWS, _SUMMED_ROWS = 4096, 1024


class ShiftedModes(NamedTuple):
    """Modes of a window, ascending.

    Parameters
    ----------
    lam : (k,) float64
        Squared frequencies.
    X : (n, k) float64
        Modes, orthonormal in M.
    bound : (k,) float64
        Upper bound of the relative error of each frequency (not squared).
    complete : bool
        True if all counted modes were found. Otherwise X has no columns.
    """

    lam: Array
    X: Array
    bound: Array
    complete: bool


def eigen_residuals(stiffness: Operator, mass: Operator, X: Array, lam: Array) -> Array:
    """Residuals K x - lam M x of modes.

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
    X = by_rows(X)
    residual, inertia = stiffness(X), mass(X)

    def subtract(_: int, rows: slice) -> None:
        residual[rows] -= inertia[rows] * lam

    share_rows(X.shape[0], _RESIDUAL_ROWS, subtract)
    return residual


def polished(X: Array, theta: Array, sigma: float, solve: Operator, mass: Operator, deflated: Array) -> ShiftedModes:
    """Modes after one inverse iteration and a Rayleigh-Ritz step, with the error bound that the iteration proves.

    Parameters
    ----------
    X : (n, k) float64
        Ritz vectors, orthonormal in M; overwritten.
    theta : (k,) float64
        Their Ritz values, of (K - sigma M)^-1 M.
    sigma, solve, mass, deflated
        As in `modes_about`.

    Returns
    -------
    ShiftedModes

    Notes
    -----
    A X - theta X is the residual of the operator A = (K - sigma M)^-1 M. A is self-adjoint in M, so the M norm of the
    residual bounds the distance to an eigenvalue 1 / (lam - sigma) of A.
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
        # A residual of one or more proves nothing; a smaller one bounds the error of the eigenvalue.
        away[part] = np.where(residual < 1, residual / np.maximum(1 - residual, residual), np.inf) / abs(theta[part])
        scale = 1 / np.sqrt(energy)
        put(less(Y, deflated, inner(deflated, MY)), X[:, part], scale)
        # (K - sigma M) Y = M X replaces the product with K, whose round-off would exceed the energy of a low mode.
        gram[known, part] = inner(X[:, known], MY) * scale
        stiffness[known, part] = inner(X[:, known], B) * scale + sigma * gram[known, part]
    # The loop fills the upper triangles only.
    stiffness, gram = (np.triu(A) + np.triu(A, 1).T for A in (stiffness, gram))
    mu, Z = la.eigh(gram, stiffness)
    lam, Z = refined_orthonormal(stiffness, gram, 1 / mu[::-1], (Z / np.sqrt(mu))[:, ::-1])
    order = np.argsort(lam, kind="stable")
    ascending = np.argsort(sigma + 1 / theta, kind="stable")
    return ShiftedModes(lam[order], times(X, Z[:, order]), away[ascending] / (2 * lam[order]), True)


def refined_orthonormal(K: Array, M: Array, lam: Array, Z: Array) -> tuple[Array, Array]:
    """Eigenpairs of a small pencil after one step of `refine`, made orthonormal in M to round-off.

    The step corrects to first order only. Rounding rotates the modes of a cluster by more than that.
    """
    lam, Z = refine(K, M, lam, Z)
    return lam, Z - Z @ (Z.T @ M @ Z - np.eye(lam.size)) / 2


def _squared_residuals(Y: Array, X: Array, MY: Array, MX: Array, theta: Array) -> tuple[Array, Array]:
    """(Y - X theta)^T (MY - MX theta) and Y^T MY, column by column.

    The residual is formed first: the difference of its squared terms would be round-off only.
    """
    sums = np.zeros((current_settings().thread_count, 2, theta.size))

    def add(thread: int, rows: slice) -> None:
        y, my = Y[rows], MY[rows]
        sums[thread, 0] += np.einsum("ij,ij->j", y - X[rows] * theta, my - MX[rows] * theta)
        sums[thread, 1] += np.einsum("ij,ij->j", y, my)

    share_rows(X.shape[0], _SUMMED_ROWS, add)
    squared, energy = sums.sum(axis=0)
    return squared, energy
