"""Singular values of orthonormal columns under weights of very unlike size, each to its own last digits."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

__all__ = ["weighted_singular_values"]

Array = NDArray[np.float64]

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
