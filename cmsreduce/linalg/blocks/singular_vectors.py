"""Singular value decomposition of a dense matrix, which always converges."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

__all__ = ["svd"]

Array = NDArray[np.float64]


def svd(A: NDArray[np.floating[Any]], full_matrices: bool = True) -> tuple[Array, Array, Array]:
    """Singular vectors and values, as of `scipy.linalg.svd`.

    LAPACK's divide and conquer may not converge where hundreds of singular values are equal, as those of the joints of
    many equal bodies; its iteration by rotations then does, in three times the time.

    Parameters
    ----------
    A : (m, n) float64
    full_matrices : bool
        Vectors of the null spaces, too.

    Returns
    -------
    U : (m, m) or (m, k) float64
    s : (k,) float64
        k is the smaller of m and n.
    Vt : (n, n) or (k, n) float64
    """
    try:
        return la.svd(A, full_matrices=full_matrices)
    except np.linalg.LinAlgError:
        return la.svd(A, full_matrices=full_matrices, lapack_driver="gesvd")
