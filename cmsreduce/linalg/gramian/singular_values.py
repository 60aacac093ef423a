"""Singular values of large dense matrices, and accurate singular values of strongly weighted orthonormal columns."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.machine import lapack_call, lapack_offers
from cmsreduce.multifrontal import blas_threads

__all__ = ["singular_values", "weighted_singular_values"]

Array = NDArray[np.float64]

# Above this size a matrix exceeds the cache, and LAPACK's column by column reduction waits for memory.
_LARGE = 2500
# Bandwidth of the intermediate band; a wider band is quicker to reach and slower to reduce further.
_BAND = 64
# Rows of the matrix that are updated at a time, to limit memory.
_ROWS = 1024
# Options of LAPACK's dgejsv: sort rows of unlike size first, compute no left vectors, set no small value to zero.
_GRADED_ROWS, _NO_LEFT, _RIGHT, _KEEP_ALL = 2, 3, 0, 0


def singular_values(A: Array) -> Array:
    """Singular values of a matrix, largest first, accurate to a few roundings of the largest.

    Rows and columns are sorted by size first, so that the small values of a graded matrix, such as a product of
    square-root factors, keep digits of their own. Blocks of Householder reflections reduce a large matrix to a band,
    rotations reduce the band to two diagonals, and the dqds algorithm computes the values of these.

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
    # With such narrow blocks, threads would spend most of the time on waiting.
    with blas_threads(1):
        return _band_values(_banded(square))[: min(p, q)]


def weighted_singular_values(weight: Array, Q: Array) -> tuple[Array, Array]:
    """Singular values and right vectors of diag(weight) Q.

    Parameters
    ----------
    weight : (e,) float64
        Positive weights of any spread, such as natural frequencies.
    Q : (e, k) float64
        Orthonormal columns, k <= e.

    Returns
    -------
    values : (k,) float64
        Ascending. Each is accurate to a few roundings of its own size. The eigenproblem of Q^T diag(weight^2) Q would
        leave a value of 0.1 Hz ten digits beside one of 100 Hz, and six beside one of 10 kHz.
    V : (k, k) float64
        Orthogonal; the column norms of diag(weight) Q V are the values.

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
    # LAPACK scales values that could overflow.
    return np.asarray(values[::-1] * (work[0] / work[1])), np.asarray(V[:, ::-1])


def _banded(A: Array) -> Array:
    """Upper band with the same singular values as a square matrix, in LAPACK storage (b + 1, n); overwrites A."""
    n = A.shape[0]
    band = np.zeros((_BAND + 1, n), order="F")
    product = np.empty((_ROWS, n))
    for k in range(0, n, _BAND):
        c = min(_BAND, n - k)
        V, T, R = _reflections(A[k:, k : k + c])
        rest = A[k:, k + c :]
        # Rows of this block after the reflections from the left, then rows of the band after those from the right.
        Y = (rest.T @ V) @ T
        W, S, L = _reflections((rest[:c] - V[:c] @ Y.T).T)
        strip = np.hstack([np.triu(R[:c]), np.tril(L[:c].T)])
        for offset in range(min(_BAND, strip.shape[1] - 1) + 1):
            diagonal = strip.diagonal(offset)
            band[_BAND - offset, k + offset : k + offset + diagonal.size] = diagonal
        # One pass applies both updates, since the matrix is too large to be read twice.
        Z = (rest[c:] @ W - V[c:] @ (Y.T @ W)) @ S
        left, right = np.hstack([V[c:], Z]), np.ascontiguousarray(np.hstack([Y, W]).T)
        for first in range(0, left.shape[0], _ROWS):
            rows = left[first : first + _ROWS]
            change = np.matmul(rows, right, out=product[: rows.shape[0], : right.shape[1]])
            rest[c + first : c + first + rows.shape[0]] -= change
    return band


def _reflections(X: Array) -> tuple[Array, Array, Array]:
    """V, T, R of X = (I - V T V^T) R for a block of columns (m, c), with V (m, k), T (k, k) and k = min(m, c)."""
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
    """Singular values of an upper band matrix (b + 1, n), which is overwritten."""
    n, width = band.shape[1], band.shape[0] - 1
    d, e, none = np.zeros(n), np.zeros(n), np.zeros(1)
    info = lapack_call(
        "dgbbrd", b"N", n, n, 0, 0, width, band, width + 1, d, e, none, 1, none, 1, none, 1, np.zeros(2 * n)
    ) or lapack_call("dlasq1", n, d, e, np.zeros(4 * n))
    if info:
        raise MatrixError(f"the singular values of a matrix of size {n} did not converge (LAPACK: {info})")
    return d
