"""Layout of MATLAB files of level 4 and 5, checked before scipy reads them.

scipy does not check the type codes and the sizes in a file; on damaged files it allocates any amount of memory, or
crashes the process. Source: MathWorks, "MAT-File Format", level 4 and level 5.
"""

from __future__ import annotations

import struct
import zlib
from math import prod
from pathlib import Path
from typing import IO, NamedTuple

from cmsreduce.errors import ReadError
from cmsreduce.read.matrices.numpy_files import most_unpacked

__all__ = ["check_layout", "is_level_4"]

_LEVEL_4_HEADER, _LONGEST_NAME = 20, 64
# Bytes of a number by the code of its precision.
_LEVEL_4_NUMBERS = (8, 4, 4, 2, 2, 1)
_LEVEL_5_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_INT8, _INT32, _UINT32, _UTF8 = 1, 5, 6, 16
# Bytes of a number by the code of its type.
_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
_STRUCT, _SPARSE, _NUMBERS = 2, 5, range(6, 16)
# MATLAB writes no deeper structs of matrices; a damaged file could nest without end.
_DEEPEST = 8
_COMPLEX = 0x0800
_CHUNK = 1 << 16


def check_layout(path: Path, head: bytes) -> None:
    """Check the lengths of all variables of a file, and the parts of its matrices.

    Parameters
    ----------
    path : Path
        The file.
    head : bytes
        Its first hundred bytes or more.

    Raises
    ------
    ReadError
        If the file ends inside a variable, or the parts of one contradict each other.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        if head.startswith(b"MATLAB"):
            _check_level_5(path, file, size)
        elif is_level_4(head):
            _check_level_4(path, file, size)


def is_level_4(head: bytes) -> bool:
    """True if a file starts with the header of a level 4 matrix: five integers, then a name that ends with a zero."""
    return _level_4_bytes(head) is not None


def _level_4_bytes(head: bytes) -> int | None:
    """Bytes of a level 4 matrix with its header; None where there is no such header."""
    if len(head) < _LEVEL_4_HEADER + 2:
        return None
    for order in "<>":
        kind, rows, cols, imaginary, length = struct.unpack_from(order + "5i", head)
        machine, zero, precision, storage = (kind // 10**k % 10 for k in (3, 2, 1, 0))
        codes = 0 <= kind < 5000 and machine < 5 and zero == 0 and precision < 6 and storage < 3
        if codes and rows >= 0 and cols >= 0 and imaginary in (0, 1) and 2 <= length <= _LONGEST_NAME:
            name = head[_LEVEL_4_HEADER : _LEVEL_4_HEADER + length]
            if name.endswith(b"\0") and name[:-1].replace(b"_", b"a").isalnum():
                return int(_LEVEL_4_HEADER + length + rows * cols * (1 + imaginary) * _LEVEL_4_NUMBERS[precision])
    return None


def _check_level_4(path: Path, file: IO[bytes], size: int) -> None:
    at = 0
    while at < size:
        file.seek(at)
        length = _level_4_bytes(file.read(_LEVEL_4_HEADER + _LONGEST_NAME))
        if length is None or at + length > size:
            raise _damaged(path, at, f"the file has {size} bytes")
        at += length


def _check_level_5(path: Path, file: IO[bytes], size: int) -> None:
    head = file.read(_LEVEL_5_HEADER)
    order = ">" if head[-2:] == b"MI" else "<"
    at = len(head)
    while at < size or at < _LEVEL_5_HEADER:
        file.seek(at)
        tag = file.read(8)
        kind, length = struct.unpack(order + "2i", tag) if len(tag) == 8 else (0, 0)
        end = at + 8 + length
        if end > size or length < 0 or len(tag) < 8:
            raise ReadError(
                f"{path}: the MATLAB file is truncated: the variable at byte {at} needs {end} bytes up to its end "
                f"and the file has {size}; save it again, or copy it again in binary mode"
            )
        try:
            if kind == _COMPRESSED:
                inside = _Parts(_Inflated(file, length), order)
                packed = length
                kind, length = inside.integers(2)
                if length > most_unpacked(packed):
                    raise ValueError(
                        f"{packed} bytes cannot rightly hold {length}; a sparse matrix must be saved as sparse"
                    )
            else:
                inside = _Parts(file, order)
            if kind == _MATRIX:
                inside.check_matrix(length)
        except (ValueError, EOFError, zlib.error, struct.error) as error:
            raise _damaged(path, at, str(error)) from None
        at = end


def _damaged(path: Path, at: int, why: str) -> ReadError:
    return ReadError(
        f"{path}: the MATLAB file is truncated or damaged in the variable at byte {at} ({why}): save it again, or copy "
        "it again in binary mode"
    )


class _Part(NamedTuple):
    kind: int
    size: int
    content: bytes


class _Parts:
    """The parts of one matrix, in the order they are stored."""

    def __init__(self, file: IO[bytes] | _Inflated, order: str) -> None:
        self._file, self._order, self._left = file, order, 0
        self._depth = 0

    def integers(self, count: int) -> tuple[int, ...]:
        """Read integers of four bytes."""
        return struct.unpack(f"{self._order}{count}I", self._read(4 * count))

    def check_matrix(self, length: int) -> None:
        """Check the parts of a matrix of ``length`` bytes.

        Raises
        ------
        ValueError
            If a part is of the wrong type or size.
        """
        if not length:
            return
        self._left = length
        flags = self._part(8)
        if flags.kind != _UINT32 or flags.size != 8:
            raise ValueError("its flags are damaged")
        (flag,) = struct.unpack_from(self._order + "I", flags.content)
        dimensions = self._part(128)
        if dimensions.kind != _INT32 or dimensions.size < 8 or dimensions.size % 4:
            raise ValueError("its dimensions are damaged")
        shape = struct.unpack(f"{self._order}{dimensions.size // 4}i", dimensions.content)
        if min(shape) < 0:
            raise ValueError(f"its dimensions are {shape}")
        if self._part(0).kind not in (_INT8, _UTF8):
            raise ValueError("its name is damaged")
        parts = 2 if flag & _COMPLEX else 1
        if flag & 0xFF in _NUMBERS:
            for _ in range(parts):
                if (found := self._numbers()) != prod(shape):
                    raise ValueError(f"{found} numbers for a size of {' x '.join(map(str, shape))}")
        elif flag & 0xFF == _SPARSE:
            # More rows may be allocated than are used; scipy compares both with the starts.
            self._numbers()
            if (starts := self._numbers()) != shape[1] + 1:
                raise ValueError(f"{starts} starts of {shape[1]} columns")
            for _ in range(parts):
                self._numbers()
        elif flag & 0xFF == _STRUCT:
            self._check_fields(prod(shape))

    def _check_fields(self, items: int) -> None:
        """Check the matrices in the fields of a struct."""
        width, names = self._part(8), self._part(0)
        each = struct.unpack(self._order + "i", width.content[:4])[0] if width.size == 4 else 0
        if each < 1 or names.size % each or self._depth == _DEEPEST:
            raise ValueError("the names of its fields are damaged")
        for _ in range(items * (names.size // each)):
            self._left -= 8
            kind, length = self.integers(2)
            if kind != _MATRIX or length > self._left:
                raise ValueError(f"a field of type {kind} and {length} bytes")
            outside, self._depth = self._left - length, self._depth + 1
            self.check_matrix(length)
            # A matrix may have bytes after its parts, or be of a kind whose parts are not looked at.
            self._skip(max(self._left, 0) if length else 0)
            self._left, self._depth = outside, self._depth - 1

    def _numbers(self) -> int:
        """Count of numbers in the next part."""
        part = self._part(0)
        each = _SIZES.get(part.kind)
        if each is None or part.size % each:
            raise ValueError(f"a part of type {part.kind} and {part.size} bytes where numbers should be")
        return part.size // each

    def _part(self, keep: int) -> _Part:
        """The next part, with its content where that has at most ``keep`` bytes."""
        self._left -= 8
        kind, size = self.integers(2)
        if kind >> 16:
            # Four bytes or less lie within the tag.
            short, kind = kind >> 16, kind & 0xFFFF
            if short > 4:
                raise ValueError(f"a part of {short} bytes within its tag")
            return _Part(kind, short, struct.pack(self._order + "I", size)[:short])
        padded = size + (-size) % 8
        self._left -= padded
        # The last part of a matrix need not be padded.
        if self._left < -7:
            raise ValueError("a part is longer than the variable")
        if size <= keep:
            return _Part(kind, size, self._read(padded)[:size])
        self._skip(padded)
        return _Part(kind, size, b"")

    def _read(self, count: int) -> bytes:
        found = self._file.read(count)
        if len(found) < count:
            raise EOFError("it ends before its parts do")
        return found

    def _skip(self, count: int) -> None:
        if isinstance(self._file, _Inflated):
            for first in range(0, count, _CHUNK):
                self._file.read(min(_CHUNK, count - first))
        else:
            self._file.seek(count, 1)


class _Inflated:
    """Content of a compressed variable, a little at a time."""

    def __init__(self, file: IO[bytes], length: int) -> None:
        self._file, self._left, self._zlib, self._held = file, length, zlib.decompressobj(), b""

    def read(self, count: int) -> bytes:
        """The next ``count`` bytes, or those that are left."""
        while len(self._held) < count:
            packed = self._zlib.unconsumed_tail
            if not packed:
                packed = self._file.read(min(_CHUNK, self._left))
                self._left -= len(packed)
            found = self._zlib.decompress(packed, _CHUNK)
            if not found and not packed:
                break
            self._held += found
        found, self._held = self._held[:count], self._held[count:]
        return found
