"""Blocks of vectors by rows, as sparse products and searches want them, and by columns, as shapes are kept.

Small matrices, which may be sparse, as dense ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import share_rows

__all__ = [
    "by_columns",
    "by_rows",
    "dense",
    "put",
]

# Rows that are turned at a time: few enough that all their columns stay at hand.
_ROWS = 256


def by_columns(X: NDArray[Any], real: np.dtype[Any] | type[np.floating[Any]] = np.float64) -> NDArray[Any]:
    """Lay a block (n, k) out by columns (Fortran order), itself where it is; numpy's own way takes six times as long.

    Parameters
    ----------
    X : (n, k) float array
    real : dtype
        Of the result.

    Returns
    -------
    (n, k) array of ``real``
    """
    if X.strides[0] <= X.strides[1]:
        return np.asfortranarray(X, dtype=real)
    turned = np.empty(X.shape, dtype=real, order="F")
    put(X, turned)
    return turned


def by_rows(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Lay a block (n, k) out by rows (C order), itself where it is."""
    if X.flags.c_contiguous:
        return X
    turned = np.empty(X.shape)
    put(X, turned)
    return turned


def put(X: NDArray[Any], place: NDArray[Any], scale: NDArray[np.float64] | None = None) -> None:
    """Write a block (n, k), each column multiplied by its ``scale`` (k,), to where it may lie otherwise."""

    def work(_: int, rows: slice) -> None:
        place[rows] = X[rows] if scale is None else X[rows] * scale

    share_rows(X.shape[0], _ROWS, work)


def dense(A: NDArray[np.float64] | sp.sparray) -> NDArray[np.float64]:
    """Make a small matrix dense: rows of points, coordinates of a reduced body, never the dofs of a full one."""
    return np.asarray(A.toarray() if sp.issparse(A) else A)  # type: ignore[union-attr]
