"""Dof lists: one dof a line, in the order of the rows of a matrix (CalculiX writes them as ``.dof``)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable

__all__ = ["dof_list_beside", "read_dof_list"]

_DOF = re.compile(r"(\d+)(?:\s*[.,;]\s*|\s+)([0-6])")


def read_dof_list(path: Path) -> DofTable:
    """Read a dof list.

    Parameters
    ----------
    path : Path
        Text with a dof on each line: ``node.component``, or the two separated by a blank or a comma. Empty lines and
        lines that start with ``#``, ``%``, ``$`` or ``*`` are skipped.

    Returns
    -------
    DofTable

    Raises
    ------
    ReadError
        If the file is missing or empty, a line names no dof, or a dof stands in it twice.
    """
    try:
        text = path.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ReadError(f"{path}: the dof list cannot be read: {error.strerror or error}") from error
    node, component = [], []
    for number, line in enumerate(text.splitlines(), start=1):
        line = line.strip()
        if not line or line[0] in "#%$*":
            continue
        match = _DOF.fullmatch(line)
        if match is None:
            raise ReadError(
                f"{path}, line {number}: '{line[:40]}' is not a dof; write node.component, such as 1001.3 "
                "(1..3 translations, 4..6 rotations, 0 for a scalar point)"
            )
        node.append(int(match[1]))
        component.append(int(match[2]))
    if not node:
        raise ReadError(f"{path}: the dof list is empty; it needs one node.component for each row of the matrix")
    try:
        return DofTable(np.array(node, dtype=np.int64), np.array(component, dtype=np.int8))
    except (DofMapError, OverflowError) as error:
        raise ReadError(f"{path}: {error}") from error


def dof_list_beside(path: Path) -> Path | None:
    """The dof list of the same stem in the folder of a matrix file, None if there is none."""
    for suffix in (".dof", ".DOF"):
        beside = path.with_suffix(suffix)
        if beside != path and beside.is_file():
            return beside
    return None
