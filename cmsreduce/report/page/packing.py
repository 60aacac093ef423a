"""Arrays of the page in one compressed block of bytes, and curves thinned to the columns of a screen."""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["ArrayStore", "compressed", "thinned_points"]

_GAP = -32768
_TOP = 32767
# Typed arrays of a browser start at multiples of their item size.
_ALIGN = 8


class ArrayStore:
    """Collection of arrays; the page's JSON names each by its place.

    Examples
    --------
    >>> store = ArrayStore()
    >>> store.exact([1, 2, 3], "u2")
    {'at': 0, 'n': 3, 'as': 'u2'}
    """

    def __init__(self) -> None:
        self._parts: list[bytes] = []
        self._size = 0

    def exact(self, values: ArrayLike, kind: str) -> dict[str, Any]:
        """Store numbers in full; ``kind`` is one of f4, u4, u2, u1, i1."""
        array = np.asarray(values).ravel()
        return {"at": self._add(array.astype(f"<{kind}").tobytes()), "n": int(array.size), "as": kind}

    def ascending(self, values: ArrayLike) -> dict[str, Any]:
        """Store ascending whole numbers as steps, which compress better."""
        steps = np.diff(np.asarray(values, dtype=np.int64), prepend=0)
        return {**self.exact(steps, "u4" if steps.max(initial=0) > 0xFFFF else "u2"), "sum": True}

    def rounded(self, values: ArrayLike) -> dict[str, Any]:
        """Store numbers to one 65000th of their range, finer than a screen; a number that is not finite is a gap."""
        array = np.asarray(values, dtype=np.float64).ravel()
        known = np.isfinite(array)
        low = float(array[known].min()) if known.any() else 0.0
        span = float(array[known].max()) - low if known.any() else 0.0
        step = span / (2 * _TOP) if span > 0 else 1.0
        whole = np.full(array.size, _GAP, dtype=np.int64)
        whole[known] = np.rint((array[known] - low) / step).astype(np.int64) - _TOP
        found = {"at": self._add(whole.astype("<i2").tobytes()), "n": int(array.size), "as": "i2"}
        return {**found, "low": low, "step": step}

    def packed(self) -> str:
        """All bytes, compressed, in base64."""
        return compressed(b"".join(self._parts))

    def _add(self, data: bytes) -> int:
        at = self._size
        padded = data + bytes(-len(data) % _ALIGN)
        self._parts.append(padded)
        self._size += len(padded)
        return at


def compressed(data: bytes, level: int = 9) -> str:
    """Gzip in base64, without a time stamp: equal bytes give equal text."""
    return base64.b64encode(gzip.compress(data, level, mtime=0)).decode("ascii")


def thinned_points(frequency: ArrayLike, curves: ArrayLike, buckets: int = 700) -> NDArray[np.int64]:
    """Points for the same picture: the lowest and the highest of every curve in each bucket.

    Parameters
    ----------
    frequency : (f,) array_like
        Ascending; points at or below zero are left out, as the axis is logarithmic.
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
        # The library cannot divide a single bucket or a curve without width into columns.
        along = (log[known],) if buckets > 1 and log[known[0]] < log[known[-1]] else ()
        found = MinMaxDownsampler().downsample(*along, np.ascontiguousarray(curve[known]), n_out=2 * buckets)
        kept[shown[known[found.astype(np.int64)]]] = True
    return np.flatnonzero(kept)
