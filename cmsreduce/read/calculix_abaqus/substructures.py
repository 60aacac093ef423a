"""Substructures as text: the *USER ELEMENT that *SUBSTRUCTURE MATRIX OUTPUT of Abaqus and CalculiX writes.

The nodes stand in comments. Then come the dofs of the first node, and of each place in the list from which on they
differ. A matrix has its rows up to the diagonal; an unsymmetric stiffness has all of each row.
"""

from __future__ import annotations

import re
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable
from cmsreduce.read.files import read_lines
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.numbers_at_once import REAL, numbers_of
from cmsreduce.read.printed_numbers import rounding_of_printed, whole_number

__all__ = ["SUBSTRUCTURE"]

_START = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:\s*\*\*[^\n]*\n)*\s*\*\s*USER\s*ELEMENT\b[^\n]*\n", re.IGNORECASE)
_MATRIX = re.compile(rb"^[ \t]*\*[ \t]*MATRIX[ \t]*,[ \t]*TYPE[ \t]*=([^\n,]*)[^\n]*\n", re.IGNORECASE | re.MULTILINE)
_COMMENT = re.compile(rb"^[ \t]*\*\*[^\n]*\n?", re.MULTILINE)
_NUMBERS = re.compile(rf"(?:[\s,]*+{REAL})*+[\s,]*+".encode())
_HEADING = "ELEMENT NODES"
_COMPONENTS = range(1, 7)
# Numbers at each end that show how all are printed.
_ENDS = 1000


def _matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of a substructure, by their types, with the dofs of its rows.

    Raises
    ------
    ReadError
        If the nodes or the dofs are not there, or are no displacements. Loading raises it if the numbers are not as
        many as the dofs ask for.
    """
    head, *parts = _MATRIX.split(read_lines(path))
    dofs = _dofs(path, head.decode("utf-8", "replace").splitlines())
    if not parts:
        raise ReadError(f"{path}: the substructure has no *MATRIX,TYPE=; the file is cut, or the run did not end")
    names = [" ".join(name.decode("utf-8", "replace").upper().split()) for name in parts[::2]]
    size = (len(dofs), len(dofs), None)
    return [
        StoredMatrix(name, "real, as text", "symmetric", size, partial(_load, path, name, numbers, dofs))
        for name, numbers in zip(names, parts[1::2], strict=True)
    ]


def _dofs(path: Path, lines: list[str]) -> DofTable:
    """Dofs of the rows, node by node, from the lines before the first matrix."""
    nodes: list[int | None] = []
    changes: list[tuple[int, list[int | None]]] = []
    heading = False
    for line in (line.strip() for line in lines):
        words = [word for word in re.split(r"[\s,]+", line.lstrip("*")) if word]
        numbers = [whole_number(word) for word in words]
        if line.startswith("**"):
            if heading and None not in numbers:
                nodes += numbers
            heading |= " ".join(words).upper() == _HEADING
        elif words and not line.startswith("*"):
            changes.append((numbers[0] or 0, numbers[1:]) if changes else (1, numbers))
    ends = [*(place for place, _ in changes), len(nodes) + 1]
    counts = [after - before for before, after in pairwise(ends)]
    ids = [node for node in nodes if node is not None and node > 0]
    if not changes or ends[0] != 1 or min(counts) < 1 or len(ids) < max(len(nodes), 1):
        raise ReadError(
            f"{path}: the nodes of the substructure are not there, or are not those of the mesh: keep its comments "
            "(** ELEMENT NODES and the lines below), and retain nodes alone"
        )
    wrong = [dof for _, part in changes for dof in part if dof not in _COMPONENTS]
    if wrong:
        raise ReadError(
            f"{path}: dof {wrong[0]} of the substructure is no displacement or rotation: retain these alone"
        )
    of_each = [part for (_, part), count in zip(changes, counts, strict=True) for _ in range(count)]
    component = np.array([dof or 0 for part in of_each for dof in part], dtype=np.int8)
    return DofTable(np.repeat(ids, [len(part) for part in of_each]), component)


def _load(path: Path, name: str, text: bytes, dofs: DofTable) -> LabelledMatrix:
    """One of the matrices."""
    text = _COMMENT.sub(b"", text)
    if (end := _NUMBERS.match(text)) is None or end.end() < len(text):
        wrong = text[end.end() if end else 0 :].split(b"\n", 1)[0].decode("utf-8", "replace").strip()
        step = "write each substructure to a file of its own" if wrong.startswith("*") else "write the file again"
        raise ReadError(f"{path}: '{wrong[:60]}' in matrix '{name}' is no number; {step}")
    values, n = numbers_of(text), len(dofs)
    if values.size == n * n:
        A = values.reshape(n, n)
    elif values.size == n * (n + 1) // 2:
        A = np.zeros((n, n))
        A[np.tril_indices(n)] = values
        A += np.tril(A, -1).T
    else:
        raise ReadError(
            f"{path}: matrix '{name}' has {values.size} numbers, and its {n} dofs ask for {n * (n + 1) // 2} (or "
            f"{n * n} of an unsymmetric one); the file is cut, or its list of nodes is another's: write it again"
        )
    words = text.replace(b",", b" ").split()
    printed = [word.decode() for word in (words if len(words) <= 2 * _ENDS else words[:_ENDS] + words[-_ENDS:])]
    return LabelledMatrix(sp.csc_array(A), name, path, "substructure", rounding_of_printed(printed), dofs)


SUBSTRUCTURE = MatrixFormat(
    "substructure",
    "a substructure (*USER ELEMENT) of Abaqus or CalculiX",
    lambda path, head: _START.match(head) is not None,
    _matrices,
)
