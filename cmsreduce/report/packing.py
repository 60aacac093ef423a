"""Arrays of the page, packed: one compressed block of bytes, and where in it each array stands."""

from __future__ import annotations

import base64
import gzip
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["ArrayStore", "compressed"]

_GAP = -32768
_TOP = 32767
# Typed arrays of a browser start at multiples of their item size.
_ALIGN = 8


class ArrayStore:
    """Collects arrays; each is named in the page's JSON by where it stands.

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
        """Store numbers as they are; ``kind`` is one of f4, u4, u2, u1, i1."""
        array = np.asarray(values).ravel()
        return {"at": self._add(array.astype(f"<{kind}").tobytes()), "n": int(array.size), "as": kind}

    def ascending(self, values: ArrayLike) -> dict[str, Any]:
        """Store ascending whole numbers as steps, which compress better."""
        steps = np.diff(np.asarray(values, dtype=np.int64), prepend=0)
        return {**self.exact(steps, "u4" if steps.max(initial=0) > 0xFFFF else "u2"), "sum": True}

    def rounded(self, values: ArrayLike) -> dict[str, Any]:
        """Store numbers to one 65000th of their range, finer than a screen; what is not finite is a gap."""
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
    """Gzip in base64, the same for the same bytes: it holds no time."""
    return base64.b64encode(gzip.compress(data, level, mtime=0)).decode("ascii")
