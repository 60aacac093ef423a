"""Energies of shapes: Phi^T A Phi, block by block, so that no second basis is ever in memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.products import symmetric_product

__all__ = ["column_blocks", "congruence"]

# Wide enough to read a matrix few times, narrow enough beside the block of right-hand sides of a solve.
_COLUMNS = 32


def column_blocks(m: int) -> Iterator[slice]:
    """Columns of a basis of m shapes, some at a time."""
    return (slice(first, min(first + _COLUMNS, m)) for first in range(0, m, _COLUMNS))


def congruence(A: sp.csc_array | NDArray[np.float64], Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Phi^T A Phi of a symmetric matrix.

    Parameters
    ----------
    A : (n, n) array, sparse or dense
        Symmetric.
    Phi : (n, m) float64
        Shapes; they may be on disk.

    Returns
    -------
    (m, m) float64
        Symmetric to the last bit.
    """
    m = Phi.shape[1]
    found, product = np.empty((m, m)), symmetric_product(A) if sp.issparse(A) else A.__matmul__
    for part in column_blocks(m):
        # Of a symmetric matrix half is enough: the basis is read half as often.
        known = slice(part.stop)
        found[known, part] = Phi[:, known].T @ product(Phi[:, part])
        found[part, known] = found[known, part].T
        found[part, part] = (found[part, part] + found[part, part].T) / 2
    return found
