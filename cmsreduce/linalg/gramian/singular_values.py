"""Singular values of large dense matrices, without vectors, in products of matrices instead of matrix and vector.

Singular values of orthonormal columns under weights of very unlike size, each to its own last digits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.machine import lapack_call, lapack_offers
from cmsreduce.multifrontal import blas_threads

__all__ = [
    "singular_values",
    "weighted_singular_values",
]

Array = NDArray[np.float64]

# From this size on a matrix no longer fits a cache, and what LAPACK takes one column at a time waits for memory.
_LARGE = 2500
# Bandwidth in between: wider bands are quicker to reach and slower to leave.
_BAND = 64
# Rows of the matrix that are updated at a time, for the sake of memory.
_ROWS = 1024


def singular_values(A: NDArray[np.float64]) -> Array:
    """Singular values of a matrix, largest first, to a few roundings of the largest.

    Rows and columns are put in order of their size first: in a matrix that is graded, as products of square-root
    factors are, small values then keep digits of their own. A large matrix is brought to a band by blocks of
    Householder reflections, the band to two diagonals by rotations, and these to their values by differences of
    quotients.

    Parameters
    ----------
    A : (p, q) float64

    Returns
    -------
    (min(p, q),) float64

    Raises
    ------
    MatrixError
        If the iteration of the last step does not end.

    Notes
    -----
    Source: Grosser and Lang (1999) for the two steps, LAPACK's DGBBRD and DLASQ1 for the second and the last.
    """
    p, q = A.shape
    rows, columns = (np.argsort(-np.linalg.norm(A, axis=axis), kind="stable") for axis in (1, 0))
    if min(p, q) < _LARGE or not lapack_offers("dgbbrd", "dlasq1"):
        return np.asarray(la.svdvals(A[np.ix_(rows, columns)]))
    square = np.zeros((max(p, q), max(p, q)))
    square[:p, :q] = A[np.ix_(rows, columns)]
    # Blocks are so narrow that threads wait for each other longer than they work.
    with blas_threads(1):
        return _band_values(_banded(square))[: min(p, q)]


def _banded(A: Array) -> Array:
    """Upper band of a square matrix with the same singular values, as LAPACK stores it (b + 1, n); A is used up."""
    n = A.shape[0]
    band = np.zeros((_BAND + 1, n), order="F")
    product = np.empty((_ROWS, n))
    for k in range(0, n, _BAND):
        c = min(_BAND, n - k)
        V, T, R = _reflections(A[k:, k : k + c])
        rest = A[k:, k + c :]
        # The rows of this block after the reflections from the left, and the band's after those from the right.
        Y = (rest.T @ V) @ T
        W, S, L = _reflections((rest[:c] - V[:c] @ Y.T).T)
        strip = np.hstack([np.triu(R[:c]), np.tril(L[:c].T)])
        for offset in range(min(_BAND, strip.shape[1] - 1) + 1):
            diagonal = strip.diagonal(offset)
            band[_BAND - offset, k + offset : k + offset + diagonal.size] = diagonal
        # Both at once, since the matrix is too large to be read twice.
        Z = (rest[c:] @ W - V[c:] @ (Y.T @ W)) @ S
        left, right = np.hstack([V[c:], Z]), np.ascontiguousarray(np.hstack([Y, W]).T)
        for first in range(0, left.shape[0], _ROWS):
            rows = left[first : first + _ROWS]
            change = np.matmul(rows, right, out=product[: rows.shape[0], : right.shape[1]])
            rest[c + first : c + first + rows.shape[0]] -= change
    return band


def _reflections(X: Array) -> tuple[Array, Array, Array]:
    """V, T, R of X = (I - V T V^T) R, for a block of columns (m, c): V (m, k), T (k, k), k = min(m, c)."""
    if 0 in X.shape:
        none = np.zeros((X.shape[0], 0))
        return none, np.zeros((0, 0)), np.zeros(X.shape)
    found: Any = la.qr(X, mode="raw", check_finite=False)
    (H, tau), R = found
    k = tau.size
    V = np.tril(H[:, :k], -1)
    np.fill_diagonal(V, 1.0)
    overlap, T = V.T @ V, np.zeros((k, k))
    for j in range(k):
        T[:j, j] = -tau[j] * (T[:j, :j] @ overlap[:j, j])
        T[j, j] = tau[j]
    return V, T, R


def _band_values(band: Array) -> Array:
    """Singular values of an upper band matrix (b + 1, n), which is used up."""
    n, width = band.shape[1], band.shape[0] - 1
    d, e, none = np.zeros(n), np.zeros(n), np.zeros(1)
    info = lapack_call(
        "dgbbrd", b"N", n, n, 0, 0, width, band, width + 1, d, e, none, 1, none, 1, none, 1, np.zeros(2 * n)
    ) or lapack_call("dlasq1", n, d, e, np.zeros(4 * n))
    if info:
        raise MatrixError(f"the singular values of a matrix of size {n} did not converge (LAPACK: {info})")
    return d


# Options of LAPACK's dgejsv: rows of unlike size are sorted first, nothing is set to zero, left vectors are not made.
_GRADED_ROWS, _NO_LEFT, _RIGHT, _KEEP_ALL = 2, 3, 0, 0


def weighted_singular_values(weight: Array, Q: Array) -> tuple[Array, Array]:
    """Singular values and right vectors of diag(weight) Q.

    Parameters
    ----------
    weight : (e,) float64
        Positive, of any spread; natural frequencies, for one.
    Q : (e, k) float64
        Orthonormal columns, k <= e.

    Returns
    -------
    values : (k,) float64
        Ascending. Each is known to a few roundings of its own size: in an eigenproblem of Q^T diag(weight^2) Q one of
        0.1 Hz beside one of 100 Hz would keep ten digits, and beside one of 10 kHz six.
    V : (k, k) float64
        Orthogonal; ||weight * (Q V)|| by columns are the values.

    Raises
    ------
    LinAlgError
        If the rotations do not converge.

    Notes
    -----
    One-sided Jacobi rotations after pivoting: Demmel and Veselic, SIAM J. Matrix Anal. Appl. 13 (1992) 1204; Drmac and
    Veselic, ibid. 29 (2008) 1322.

    Examples
    --------
    >>> values, _ = weighted_singular_values(np.array([1.0, 1e9]), np.eye(2))
    >>> (values / [1.0, 1e9]).round(14).tolist()
    [1.0, 1.0]
    """
    if not Q.shape[1]:
        return np.empty(0), np.empty((0, 0))
    values, _, V, work, _, info = la.lapack.dgejsv(
        weight[:, None] * Q, joba=_GRADED_ROWS, jobu=_NO_LEFT, jobv=_RIGHT, jobr=_KEEP_ALL
    )
    if info:
        raise la.LinAlgError(f"the rotations of dgejsv do not converge (info {info})")
    # Values that could overflow come scaled.
    return np.asarray(values[::-1] * (work[0] / work[1])), np.asarray(V[:, ::-1])
