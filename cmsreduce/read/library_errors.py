"""What libraries raise on damaged files, turned into one clear message."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cmsreduce.errors import ReadError

__all__ = ["LIBRARY_ERRORS", "reading"]

LIBRARY_ERRORS = (
    struct.error,
    tokenize.TokenError,
    zlib.error,
    zipfile.BadZipFile,
    ValueError,
    TypeError,
    LookupError,
    OSError,
    EOFError,
    ArithmeticError,
    MemoryError,
    NotImplementedError,
    AttributeError,
    RuntimeError,
)
"""Readers of binary formats raise any of these when a file is damaged; none is a message for an engineer."""


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Turn a library's exception on a damaged file into a ReadError.

    Parameters
    ----------
    path : Path
        File being read.
    what : str
        What is being read, such as ``the OP4 matrix 'KAA'``.

    Raises
    ------
    ReadError
        In place of the library's exception.
    """
    try:
        yield
    except LIBRARY_ERRORS as error:
        said = " ".join(str(error).split()) or type(error).__name__
        raise ReadError(
            f"{path}: {what} cannot be read: {said}. The file ({path.stat().st_size} bytes) is truncated or damaged: "
            "write it again, or copy it again in binary mode"
        ) from error
