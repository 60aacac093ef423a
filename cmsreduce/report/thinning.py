"""Thin curves to what a screen shows, without losing a peak."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["thinned_points"]


def thinned_points(frequency: ArrayLike, curves: ArrayLike, buckets: int = 700) -> NDArray[np.int64]:
    """Points that draw the same picture: the lowest and the highest of every curve in each bucket.

    Parameters
    ----------
    frequency : (f,) array_like
        Ascending; points at or below zero have no place on a logarithmic axis and are left out.
    curves : (c, f) array_like
        Curves over one grid; NaN is a gap.
    buckets : int
        Columns of the picture, of equal width in log frequency.

    Returns
    -------
    (t,) int64
        Ascending, first and last point included; at most 2 c buckets + 2.

    Examples
    --------
    >>> thinned_points([1, 2, 3, 4, 5, 6, 7, 8], [[0, 0, 9, 0, 0, -3, 0, 0]], buckets=1)
    array([0, 2, 5, 7])
    """
    from tsdownsample import MinMaxDownsampler

    hz, values = np.asarray(frequency, dtype=np.float64), np.atleast_2d(np.asarray(curves, dtype=np.float64))
    shown = np.flatnonzero(hz > 0)
    if shown.size <= 2:
        return shown
    log = np.log(hz[shown])
    kept = np.zeros(hz.size, dtype=bool)
    kept[shown[[0, -1]]] = True
    for curve in values[:, shown]:
        # Gaps have no place in the order of values.
        known = np.flatnonzero(np.isfinite(curve))
        if known.size <= 2 * buckets:
            kept[shown[known]] = True
            continue
        # The library cannot divide one bucket, or no width at all, into columns: then there are none to divide.
        along = (log[known],) if buckets > 1 and log[known[0]] < log[known[-1]] else ()
        found = MinMaxDownsampler().downsample(*along, np.ascontiguousarray(curve[known]), n_out=2 * buckets)
        kept[shown[known[found.astype(np.int64)]]] = True
    return np.flatnonzero(kept)
