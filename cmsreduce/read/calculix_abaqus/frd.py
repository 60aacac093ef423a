"""Nodes of a CalculiX result file (.frd)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = ["is_frd", "read_frd"]

_ID_WIDTH = {0: 5, 1: 10}  # by the format code at the end of the header of the node block
_KEY, _REAL = 3, 12
_SAMPLE = 2000


def is_frd(head: str) -> bool:
    """Whether text from the start of a file looks like .frd: its first record is 1C."""
    return head.lstrip("\r\n").startswith("    1C")


def read_frd(path: Path) -> Nodes:
    """Read the node block of an ascii .frd file.

    Parameters
    ----------
    path : Path
        Result file.

    Returns
    -------
    Nodes
        In order of the file, moving along the basic axes.

    Raises
    ------
    ReadError
        If there is no node block, it is binary, or it is damaged.
    """
    ids: list[int] = []
    xyz: list[list[float]] = []
    with path.open(encoding="utf-8", errors="replace") as stream:
        numbered = enumerate(stream, start=1)
        header = next((line for _, line in numbered if line.startswith("    2C")), None)
        if header is None:
            raise ReadError(f"{path}: no node block (record 2C) in this .frd file; write it with *NODE FILE")
        code = int(header.split()[-1]) if header.split()[-1].isdigit() else -1
        if code not in _ID_WIDTH:
            raise ReadError(f"{path}: the node block is binary (format {code}); write an ascii .frd file")
        start = _KEY + _ID_WIDTH[code]
        for number, line in numbered:
            if not line.startswith(" -1"):
                break
            try:
                ids.append(int(line[_KEY:start]))
                xyz.append([float(line[at : at + _REAL]) for at in range(start, start + 3 * _REAL, _REAL)])
            except ValueError:
                raise ReadError(f"{path}, line {number}: '{line.rstrip()}' is no node; the file is damaged") from None
    promised = header.split()[1]
    if promised.isdigit() and int(promised) != len(ids):
        raise ReadError(f"{path}: {promised} nodes are announced and {len(ids)} are there; the file is truncated")
    points = np.array(xyz).reshape(-1, 3)
    stride = max(1, len(points) // _SAMPLE)
    return Nodes.in_basic(ids, points, float(printed_rounding(points[::stride]).max(initial=0.0)))
