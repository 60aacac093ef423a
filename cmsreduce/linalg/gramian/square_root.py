"""Square-root factors of Gramians, Hankel singular values and balanced states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.linalg import svds

from cmsreduce.linalg.gramian.singular_values import singular_values

__all__ = ["Balancing", "balancing", "hankel_norm", "hankel_singular_values", "semidefinite_root"]

Array = NDArray[np.float64]

_DOUBLE = 2.0**-53
# Up to this size the norm of a matrix comes from all its singular values; above, iteration for the largest is quicker.
_SMALL = 300
# Relative accuracy of a norm; a ranking shows four digits.
_NORM = 1e-6


def semidefinite_root(W: Array) -> Array:
    """Factor a positive semi-definite matrix.

    Rows are scaled to a unit diagonal first, so that weak states keep their digits beside strong ones. Cholesky's
    method takes the largest pivot at each step and stops when only rounding is left.

    Parameters
    ----------
    W : (n, n) float64
        Symmetric, positive semi-definite to rounding.

    Returns
    -------
    (n, r) float64
        L with W = L L^T; r is the numerical rank.

    Examples
    --------
    >>> semidefinite_root(np.array([[4.0, 2.0], [2.0, 1.0]])).ravel().tolist()
    [2.0, 1.0]
    """
    size = np.sqrt(np.maximum(W.diagonal(), 0.0))
    active = np.flatnonzero(size > 0)
    if active.size == 0:
        return np.zeros((W.shape[0], 0))
    scaled = W[np.ix_(active, active)] / np.outer(size[active], size[active])
    factor, pivot, rank, _ = la.lapack.dpstrf(scaled, tol=active.size * _DOUBLE, lower=1)
    L = np.zeros((W.shape[0], rank))
    L[active[pivot - 1]] = np.tril(factor)[:, :rank]
    return np.asarray(size[:, None] * L)


def hankel_singular_values(Lc: Array, Lo: Array) -> Array:
    """Hankel singular values from the square-root factors of both Gramians, largest first.

    Parameters
    ----------
    Lc, Lo : (n, r), (n, s) float64
        Factors of the controllability and the observability Gramian.

    Returns
    -------
    (n,) float64
        Zeros beyond the rank.
    """
    values = np.zeros(Lc.shape[0])
    if Lc.shape[1] and Lo.shape[1]:
        found = singular_values(Lo.T @ Lc)
        values[: found.size] = found
    return values


def hankel_norm(Lc: Array, Lo: Array) -> float:
    """Largest Hankel singular value from the square-root factors of both Gramians (n, r), (n, s).

    The norm of some states alone needs only their rows of both factors.
    """
    product = Lo.T @ Lc
    if 0 in product.shape:
        return 0.0
    if min(product.shape) <= _SMALL:
        return float(np.linalg.norm(product, 2))
    start = np.random.default_rng(0).standard_normal(min(product.shape))
    return float(svds(product, k=1, tol=_NORM, v0=start, return_singular_vectors=False)[0])


@dataclass(frozen=True, eq=False)
class Balancing:
    """Balanced states z = left^T x, x = right z: both Gramians become diag(sigma).

    Parameters
    ----------
    right, left : (n, k) float64
        left^T right is the identity.
    sigma : (k,) float64
        The k Hankel singular values that exceed rounding, largest first.
    """

    right: Array
    left: Array
    sigma: Array


def balancing(Lc: Array, Lo: Array) -> Balancing:
    """Balance a model by the square-root method.

    Parameters
    ----------
    Lc, Lo : (n, r), (n, s) float64
        Square-root factors of the controllability and the observability Gramian.

    Notes
    -----
    Source: Laub, Heath, Paige and Ward (1987), in the form of Tombs and Postlethwaite (1987), which accepts models that
    are not minimal. States below rounding are left out.
    """
    if not (Lc.shape[1] and Lo.shape[1]):
        none = np.zeros((Lc.shape[0], 0))
        return Balancing(none, none, np.zeros(0))
    U, sigma, Vt = la.svd(Lo.T @ Lc, full_matrices=False)
    k = int(np.count_nonzero(sigma > Lc.shape[0] * _DOUBLE * sigma[0]))
    root = np.sqrt(sigma[:k])
    return Balancing(Lc @ Vt[:k].T / root, Lo @ U[:, :k] / root, sigma[:k])
