"""Dofs of the rows of an ANSYS matrix: the nodes that APDL Math exports, or the mapping file of HBMAT.

``*VEC,MAP,I,IMPORT,FULL,file.full,BACK`` and ``*EXPORT,MAP,MMF,map.txt`` write one node number for each block of rows,
in the order of the matrix, as a Matrix Market array of integers. HBMAT writes a line with number, node and label of
each row.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable
from cmsreduce.read.files import read_head, read_text
from cmsreduce.read.formats import COMPONENTS
from cmsreduce.read.matrices import MATRIX_MARKET

__all__ = ["is_row_mapping", "mapping_beside", "read_row_mapping"]

# Rows of a node: the plane, translations, or translations and rotations.
_DOFS_OF_A_NODE = (2, 3, 6)
_HEAD = 1 << 12
_HEADING = re.compile(r"\s*MATRIX\s+EQN\s+NODE\s+DOF\s*", re.IGNORECASE)
_NUMBER = re.compile(r"[0-9]{1,15}")


def is_row_mapping(path: Path) -> bool:
    """True for a mapping file of HBMAT, and for one column of integers in a Matrix Market array, which is no matrix."""
    head = read_head(path, _HEAD, f"{path}: the dof list")
    line = head.decode("utf-8-sig", errors="replace").lower().split("\n", 1)[0]
    if _HEADING.fullmatch(line):
        return True
    first = line.split()
    integers = MATRIX_MARKET.detect(path, head) and first[2:4] == ["array", "integer"]
    return integers and MATRIX_MARKET.read(path)[0].info.cols == 1


def mapping_beside(path: Path) -> Path | None:
    """The mapping file that HBMAT wrote with a matrix: of the same stem in its folder; None if there is none."""
    beside = path.with_suffix(".mapping")
    return beside if beside != path and beside.is_file() and is_row_mapping(beside) else None


def read_row_mapping(path: Path, rows: int) -> DofTable:
    """Dofs of the rows of a matrix whose nodes, in order, are in a file.

    Parameters
    ----------
    path : Path
        Matrix Market array of node numbers, or mapping file of HBMAT.
    rows : int
        Rows of the matrix; in an array all nodes have an equal number of them.

    Returns
    -------
    DofTable

    Raises
    ------
    ReadError
        If the numbers are no node ids, or the rows are not 2, 3 or 6 for each of them; if a mapping file has no line
        for a row, or a dof that is no displacement.
    """
    head = read_head(path, _HEAD).decode("utf-8-sig", errors="replace")
    if _HEADING.fullmatch(head.split("\n", 1)[0]):
        return _mapped_rows(path, rows)
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


def _mapped_rows(path: Path, rows: int) -> DofTable:
    """Dofs of the rows that a mapping file of HBMAT lists in their order."""
    node, component = np.zeros(rows, dtype=np.int64), np.full(rows, -1, dtype=np.int8)
    for at, line in enumerate(read_text(path).splitlines()[1:], start=2):
        words = line.split()
        if not words or _HEADING.fullmatch(line):
            continue
        if len(words) != 3 or not (_NUMBER.fullmatch(words[0]) and _NUMBER.fullmatch(words[1])):
            raise ReadError(f"{path}, line {at}: '{line.strip()[:60]}' is no row of a matrix: number, node, dof")
        if words[2].upper() not in COMPONENTS:
            raise ReadError(
                f"{path}, line {at}: row {words[0]} is {words[2]} of node {words[1]}; only displacements and rotations "
                "can be reduced"
            )
        row = int(words[0]) - 1
        if not 0 <= row < rows:
            raise ReadError(
                f"{path}, line {at}: names row {words[0]}, and the matrix has {rows}; it belongs to another one"
            )
        node[row], component[row] = int(words[1]), COMPONENTS[words[2].upper()]
    missing = np.flatnonzero(component < 0)
    if missing.size:
        raise ReadError(
            f"{path}: has no line for {missing.size} of {rows} rows, the first is row {missing[0] + 1}; rows of a "
            "superelement without a node stand for its modes: write `rows:` as node.component, with a number of your "
            "own and .0 for each of these"
        )
    try:
        return DofTable(node, component)
    except DofMapError as error:
        raise ReadError(f"{path}: {error}") from error
