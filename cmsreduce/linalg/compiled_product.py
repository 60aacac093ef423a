"""Products of a sparse matrix with blocks of vectors, compiled: each row of the matrix is read once."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.layout import by_rows
from cmsreduce.linalg.loops import loop
from cmsreduce.linalg.register_kernels import NARROW, WIDE, sparse_narrow, sparse_wide
from cmsreduce.linalg.solver_settings import current_settings

__all__ = ["compiled_product"]

Array = NDArray[np.float64]
Product = Callable[[Array], Array]


def compiled_product(A: sp.csc_array, few: Product) -> Product:
    """Product of a symmetric matrix with blocks of vectors.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; its columns are read as rows, without a copy.
    few : callable
        Product with blocks of fewer columns than fill a register.

    Returns
    -------
    callable
        X -> A X, (n,) or (n, k).
    """
    n, threads = A.shape[0], current_settings().thread_count
    # Each thread has rows of its own, as many entries as the others.
    cuts = np.searchsorted(A.indptr, np.linspace(0, A.nnz, threads + 1)[1:-1]).tolist()

    def product(X: Array) -> Array:
        if X.ndim == 1 or X.shape[1] < NARROW:
            return few(X)
        given = by_rows(np.asarray(X, dtype=np.float64))
        found, k = np.empty(given.shape), given.shape[1]
        x, y = given.reshape(-1), found.reshape(-1)

        def work(first: int, last: int) -> None:
            _rows(A.data, A.indices, A.indptr, first, last, x, y, k)

        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(work, [0, *cuts], [*cuts, n]))
        return found

    return product


@loop
def _rows(
    entries: Array, columns: NDArray[Any], starts: NDArray[Any], first: int, last: int, x: Array, y: Array, k: int
) -> None:
    """Some rows of A X, for a block with rows of k entries."""
    for i in range(first, last):
        q = 0
        while q < k:
            if q + WIDE <= k:
                sparse_wide(entries, columns, np.int64(starts[i]), np.int64(starts[i + 1]), x, q, y, i * k + q, k)
                q += WIDE
            else:
                # The last columns may be done twice: there is nothing to fill them up with.
                q = min(q, k - NARROW)
                sparse_narrow(entries, columns, np.int64(starts[i]), np.int64(starts[i + 1]), x, q, y, i * k + q, k)
                q += NARROW
