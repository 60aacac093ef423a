"""Fill-reducing orders that were found, by the pattern that they belong to."""

from __future__ import annotations

import zlib
from typing import Any

from numpy.typing import NDArray

__all__ = ["KnownOrders"]

# Patterns whose order is remembered: those of a few components at work, and of the parts of one.
_KNOWN = 8


class KnownOrders:
    """Orders that were found for patterns, so that K, K - sigma M at any shift and what follows are ordered once.

    They stay in their process: each finds its own.
    """

    def __init__(self) -> None:
        self._found: dict[int, NDArray[Any]] = {}

    def __reduce__(self) -> tuple[type[KnownOrders], tuple[()]]:
        return type(self), ()

    def of(self, starts: NDArray[Any], indices: NDArray[Any]) -> NDArray[Any] | None:
        """Order (n,) that was found for a pattern in compressed form; None for another one."""
        return self._found.get(_fingerprint(starts, indices))

    def keep(self, starts: NDArray[Any], indices: NDArray[Any], order: NDArray[Any]) -> None:
        """Remember an order (n,); the oldest is forgotten."""
        self._found[_fingerprint(starts, indices)] = order
        while len(self._found) > _KNOWN:
            del self._found[next(iter(self._found))]


def _fingerprint(starts: NDArray[Any], indices: NDArray[Any]) -> int:
    """Number of a pattern: two that share one by chance cost each other fill, not digits, if they have as many rows."""
    return zlib.crc32(indices.data, zlib.crc32(starts.data)) << 32 | starts.size
