"""Node of each block of rows of an ANSYS matrix, as APDL Math exports it.

``*VEC,MAP,I,IMPORT,FULL,file.full,BACK`` and ``*EXPORT,MAP,MMF,map.txt`` write one node number for each block of rows,
in the order of the matrix, as a Matrix Market array of integers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable
from cmsreduce.read.files import read_head
from cmsreduce.read.matrices import MATRIX_MARKET

__all__ = ["is_row_mapping", "read_row_mapping"]

# Rows of a node: the plane, translations, or translations and rotations.
_DOFS_OF_A_NODE = (2, 3, 6)
_HEAD = 1 << 12


def is_row_mapping(path: Path) -> bool:
    """True for one column of integers in a Matrix Market array, which is no matrix of a body."""
    head = read_head(path, _HEAD, f"{path}: the dof list")
    first = head.decode("utf-8-sig", errors="replace").lower().split("\n", 1)[0].split()
    integers = MATRIX_MARKET.detect(path, head) and first[2:4] == ["array", "integer"]
    return integers and MATRIX_MARKET.read(path)[0].info.cols == 1


def read_row_mapping(path: Path, rows: int) -> DofTable:
    """Dofs of the rows of a matrix whose nodes, in order, are in a file.

    Parameters
    ----------
    path : Path
        Matrix Market array of node numbers.
    rows : int
        Rows of the matrix; all nodes have an equal number of them.

    Returns
    -------
    DofTable

    Raises
    ------
    ReadError
        If the numbers are no node ids, or the rows are not 2, 3 or 6 for each of them.
    """
    nodes = MATRIX_MARKET.read(path)[0].load().A.toarray().ravel()
    if not nodes.size or nodes.min() < 1:
        raise ReadError(f"{path}: node numbers are positive integers; export the vector BACK of the .full file")
    count, rest = divmod(rows, nodes.size)
    if rest or count not in _DOFS_OF_A_NODE:
        raise ReadError(
            f"{path}: names {nodes.size} nodes for {rows} rows, and only 2, 3 or 6 rows of every node can be told "
            "apart. Where nodes have unlike dofs, or supports took rows away, write `rows:` as a list of "
            "node.component, one a line, or give the .full file itself as stiffness and mass"
        )
    ids = nodes.astype(np.int64)
    try:
        return DofTable(np.repeat(ids, count), np.tile(np.arange(1, count + 1, dtype=np.int8), ids.size))
    except DofMapError as error:
        raise ReadError(f"{path}: {error}") from error
