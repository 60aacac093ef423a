"""Energies of shapes over many dofs, with more digits than the entries have."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Matrix

__all__ = ["energies"]

# Columns at once: the products are held in sixteen bytes an entry.
_BLOCK = 16


def energies(A: Matrix, X: NDArray[np.float64]) -> NDArray[np.float64]:
    """x^T A x of each column, summed in extended precision.

    Parameters
    ----------
    A : (n, n) float64 or sparse array
        Symmetric.
    X : (n, k) float64
        Shapes.

    Returns
    -------
    (k,) float64

    Notes
    -----
    The strain energy of a mode of 0.1 Hz is what terms as large as those of a mode of 10 kHz leave of each other: ten
    digits of sixteen are gone. ``numpy.longdouble`` has three more than a double on x86, and as many where the
    hardware has no wider number.

    Examples
    --------
    >>> energies(np.array([[1e17, -1e17], [-1e17, 1e17 + 64]]), np.ones((2, 1))).tolist()
    [64.0]
    """
    rows = sp.csr_array(A).astype(np.longdouble)
    found = np.empty(X.shape[1])
    for start in range(0, X.shape[1], _BLOCK):
        x = np.asarray(X[:, start : start + _BLOCK], dtype=np.longdouble)
        found[start : start + _BLOCK] = (x * (rows @ x)).sum(axis=0)
    return found
