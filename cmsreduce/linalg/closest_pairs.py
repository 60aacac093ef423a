"""Pairs of two lists, one to one, whose distances add up to the least."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

__all__ = ["closest_pairs"]


def closest_pairs(distance: NDArray[np.float64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pair as many as the shorter list has, as closely as can be in all.

    Parameters
    ----------
    distance : (a, b) float64
        Finite, not negative.

    Returns
    -------
    i, j : (min(a, b),) int64
        Members of the first list, ascending, and of the second.

    Notes
    -----
    Of scipy's graphs, which are in use anyway: to load ``scipy.optimize`` for its assignment takes 0.15 s, a tenth of a
    small body's run. Where several pairings are as close, it is not told which is taken.
    """
    if not distance.size:
        return np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)
    # A graph has no edge of length zero; as many edges are taken in any case, so all may be longer by as much.
    longer = distance + (float(distance.max()) or 1.0)
    i, j = min_weight_full_bipartite_matching(sp.csr_array(longer))
    order = np.argsort(i)
    return np.asarray(i[order], dtype=np.int64), np.asarray(j[order], dtype=np.int64)
