"""Layout of blocks of vectors: by rows for sparse products and searches, by columns for shapes and solves."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import share_rows

__all__ = ["by_columns", "by_rows", "dense", "put"]

# Rows that are copied at a time: few enough that all their columns stay in the cache.
_ROWS = 256


def by_columns(X: NDArray[Any], real: np.dtype[Any] | type[np.floating[Any]] = np.float64) -> NDArray[Any]:
    """Return a block (n, k) by columns (Fortran order); the block itself if it is.

    A copy by numpy would take six times as long.

    Parameters
    ----------
    X : (n, k) float array
    real : dtype
        Type of the result.

    Returns
    -------
    (n, k) array of ``real``
    """
    if X.strides[0] <= X.strides[1]:
        return np.asfortranarray(X, dtype=real)
    copy = np.empty(X.shape, dtype=real, order="F")
    put(X, copy)
    return copy


def by_rows(X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a block (n, k) by rows (C order); the block itself if it is."""
    if X.flags.c_contiguous:
        return X
    copy = np.empty(X.shape)
    put(X, copy)
    return copy


def put(X: NDArray[Any], place: NDArray[Any], scale: NDArray[np.float64] | None = None) -> None:
    """Copy a block (n, k), each column times its ``scale`` (k,), into ``place``, which may have another layout."""

    def work(_: int, rows: slice) -> None:
        place[rows] = X[rows] if scale is None else X[rows] * scale

    share_rows(X.shape[0], _ROWS, work)


def dense(A: NDArray[np.float64] | sp.sparray) -> NDArray[np.float64]:
    """Return a small matrix as a dense one: rows of points or reduced coordinates, never all dofs of a full body."""
    return np.asarray(A.toarray() if sp.issparse(A) else A)  # type: ignore[union-attr]
