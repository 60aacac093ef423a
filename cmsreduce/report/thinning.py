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
    hz, values = np.asarray(frequency, dtype=np.float64), np.atleast_2d(np.asarray(curves, dtype=np.float64))
    shown = np.flatnonzero(hz > 0)
    if shown.size <= 2:
        return shown
    log = np.log(hz[shown])
    width = (log[-1] - log[0]) / buckets
    bucket = np.zeros(shown.size) if width == 0 else np.minimum((log - log[0]) // width, buckets - 1)
    first = np.flatnonzero(np.diff(bucket, prepend=-1.0))
    last = np.append(first[1:], shown.size) - 1
    keep = [shown[:1], shown[-1:]]
    for curve in values[:, shown]:
        gap = np.isnan(curve)
        # Gaps are sent to the far end, so that neither extreme is ever one of them while a value stands beside it.
        lowest = np.lexsort((np.where(gap, np.inf, curve), bucket))[first]
        highest = np.lexsort((np.where(gap, -np.inf, curve), bucket))[last]
        keep += [shown[lowest], shown[highest]]
    return np.unique(np.concatenate(keep)).astype(np.int64)
