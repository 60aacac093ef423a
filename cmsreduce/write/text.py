"""Text files of numbers, written whole."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.write.atomic import atomic_path

__all__ = ["number", "put_lines", "table"]


def put_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines of ASCII; characters beyond it, as in a body's name, become question marks.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    content = "".join(f"{line}\n" for line in lines)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode("ascii", errors="replace"))


def number(value: float) -> str:
    """A number with all the digits of double precision.

    Examples
    --------
    >>> number(0.1)
    '1.0000000000000001e-01'
    """
    return f"{value:.16e}"


def table(name: str, values: NDArray[np.float64] | NDArray[np.int64], meaning: str = "") -> Iterator[str]:
    """A block of numbers under a line ``$ NAME rows columns: meaning``.

    Parameters
    ----------
    name : str
        Capital letters, by which the block is found.
    values : (r, c) float64 or int64
        Rows of numbers.
    meaning : str
        In words, for whoever opens the file.
    """
    rows, columns = values.shape
    yield f"$ {name} {rows} {columns}: {meaning}" if meaning else f"$ {name} {rows} {columns}"
    for row in values:
        yield " ".join(str(value) if values.dtype.kind == "i" else number(value) for value in row)
