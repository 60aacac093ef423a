"""Pages of a factor's entries in a file: pieces are read ahead of their use, and leave the process after it."""

from __future__ import annotations

import mmap
from collections.abc import Iterable, Iterator, Sequence
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.fronts import Blocks

__all__ = ["Pages"]

Ints = NDArray[np.int64]

# Bytes of a piece: far less than memory, and long enough to read one piece while the one before is in use.
_PIECE = 2**25
# Bytes for which the system is asked at a time: Linux reads no more than a device's largest request ahead.
_REQUEST = 2**17


class Pages:
    """Pages of a factor's entries. Without a file, or advice to the system, there is one piece and nothing to do.

    Parameters
    ----------
    blocks : Blocks
        Their values are in a file if they are a view of a `numpy.memmap` from its first byte on.
    """

    def __init__(self, blocks: Blocks) -> None:
        owner: object = blocks.values
        while isinstance(owner, np.ndarray):
            owner = owner.base
        advised = isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED")
        self._file = owner if isinstance(owner, mmap.mmap) and advised else None
        # First byte of each supernode.
        self._starts = blocks.entries[blocks.panels] * blocks.values.itemsize

    def pieces(self, parts: Iterable[range]) -> list[Ints]:
        """Supernodes of some ranges, in the pieces in which they are used."""
        every = [np.arange(part.start, part.stop) for part in parts]
        if self._file is None:
            return [np.concatenate([np.zeros(0, dtype=np.int64), *every])]
        found: list[Ints] = []
        for part in every:
            number = self._starts[part] // _PIECE
            found += [piece for piece in np.split(part, np.flatnonzero(np.diff(number)) + 1) if piece.size]
        return found

    def in_turn(self, pieces: Sequence[Ints]) -> Iterator[Ints]:
        """Pieces one after the other: the next one is read meanwhile, and the last one released."""
        for piece, following in zip_longest(pieces, pieces[1:]):
            if self._file is not None and following is not None:
                low, high = self._bytes(following)
                for start in range(low, high, _REQUEST):
                    self._file.madvise(mmap.MADV_WILLNEED, start, min(_REQUEST, high - start))
            yield piece
            self.release(piece)

    def release(self, piece: Ints) -> None:
        """Take the pages of consecutive supernodes out of the process; the system writes them to the file."""
        if self._file is not None:
            low, high = self._bytes(piece)
            self._file.madvise(mmap.MADV_DONTNEED, low, high - low)

    def _bytes(self, piece: Ints) -> tuple[int, int]:
        """First byte, at the start of a page, and last byte of consecutive supernodes."""
        low, high = int(self._starts[piece[0]]), int(self._starts[piece[-1] + 1])
        return low // mmap.PAGESIZE * mmap.PAGESIZE, high
