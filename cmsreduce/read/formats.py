"""Contract of a file format: what its readers return, and its entry in the tables of `file_kind.py`.

A new format is one folder with its readers, its ``MatrixFormat`` or ``GeometryFormat``, and one line in a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.idle_turns import IdleTurns
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.stated import Statement, nothing_stated

__all__ = [
    "CELL_CORNERS",
    "COMPONENTS",
    "NODE_ROWS",
    "Cells",
    "Geometry",
    "GeometryFormat",
    "MatrixFormat",
    "MatrixInfo",
    "StoredMatrix",
    "cells_by_kind",
    "rows_of_nodes",
]

Size = tuple[int, int, int | None]
"""Rows, columns and stored entries of a matrix."""

Cells = dict[str, NDArray[np.int64]]
"""Node ids of the corners of elements, (k, corners), by kind of cell."""

CELL_CORNERS = {
    "vertex": 1,
    "line": 2,
    "triangle": 3,
    "quad": 4,
    "tetra": 4,
    "pyramid": 5,
    "wedge": 6,
    "hexahedron": 8,
}
"""Corner nodes of each kind of cell, by meshio's names."""

NODE_ROWS = {"translations": 3, "six": 6, "plane": 2}
"""Dofs at every node: the rows that a matrix may have where no deck defines its sets."""

_NAMES = ("UX UY UZ ROTX ROTY ROTZ", "DX DY DZ DRX DRY DRZ", "U1 U2 U3 UR1 UR2 UR3", "X Y Z RX RY RZ", "TX TY TZ")
COMPONENTS = {name: component for names in _NAMES for component, name in enumerate(names.split(), start=1)}
"""Components of a node by the names that ANSYS, code_aster, Abaqus and others give them."""


@dataclass(frozen=True)
class MatrixInfo:
    """Description of one matrix of a file, without its entries.

    Parameters
    ----------
    name : str
        Name as the file spells it.
    rows, cols : int
        Size.
    nnz : int, optional
        Stored entries, where the headers give them.
    numbers : str
        Kind of number: ``real double``, ``real single``, ``complex double``, ``real double, 10 digits``.
    form : str
        The file's word for it: ``symmetric``, ``square``, ``rectangular``, or empty.
    """

    name: str
    rows: int
    cols: int
    nnz: int | None
    numbers: str
    form: str = ""


@dataclass(frozen=True)
class StoredMatrix:
    """One matrix of a file that was checked but is not loaded.

    Parameters
    ----------
    name : str
        Name as the file spells it.
    numbers, form : str
        As in MatrixInfo.
    size : tuple, or callable that returns one
        Rows, columns and stored entries. Entries are None where only loading can count them; a callable serves where
        the size itself is not in a header.
    load : callable
        Reads the matrix; raises ReadError if the entries are damaged.
    usable : bool
        False for a variable that is no matrix of numbers; loading it raises ReadError with the reason.
    """

    name: str
    numbers: str
    form: str
    size: Size | Callable[[], Size]
    load: Callable[[], LabelledMatrix]
    usable: bool = True

    @property
    def info(self) -> MatrixInfo:
        """Description without loading."""
        size = self.size() if callable(self.size) else self.size
        return MatrixInfo(self.name, *size, self.numbers, self.form)


@dataclass(frozen=True)
class MatrixFormat:
    """A format of matrix files.

    Parameters
    ----------
    name : str
        Value of the user's key ``format:``.
    words : str
        The format in words, for messages.
    detect : callable
        True for a file of this format, from its path and first bytes. Formats earlier in the table come first.
    read : callable
        Matrices of a file, in its order. Large libraries are imported inside it.
    named : bool
        True if the file names its matrices; otherwise the file's stem is the name.
    dof_list : bool
        True if a ``.dof`` file of the same stem labels the rows.
    """

    name: str
    words: str
    detect: Callable[[Path, bytes], bool]
    read: Callable[[Path], list[StoredMatrix]]
    named: bool = True
    dof_list: bool = False


@dataclass(frozen=True)
class StatedLength:
    """Unit of length that a geometry file states.

    Parameters
    ----------
    metres : float
        Metres in one unit of its coordinates.
    where : str
        Part of the file that states it, such as ``/UNITS,MPA``.
    """

    metres: float
    where: str


@dataclass(frozen=True, eq=False)
class Geometry:
    """Nodes of a body and the dof tables that its matrices may have.

    Parameters
    ----------
    path : Path
        File named by the user.
    nodes : Nodes
        Nodes in order of the file; none for a deck of scalar points.
    rows : mapping of str to DofTable
        Tables that the rows of a matrix may be, the likeliest first, by name of the set.
    sets : mapping of str to DofTable
        Named dof sets, such as ``b`` and ``q``.
    constrained : DofTable, optional
        Dofs held at zero by the deck.
    files : tuple of Path
        Files read.
    remarks : tuple of str
        Parts of the deck that were not understood.
    node_sets : mapping of str to (k,) int64
        Nodes of the sets of nodes that the file names, in its order.
    expanded : mapping of int to (tuple of int)
        Nodes that a node of a shell or a beam became where the solver makes solids of them.
    turning : mapping of int to int
        Node by the number under which its rotations have rows: these are labelled with components 1..3.
    length : StatedLength, optional
        Unit of the coordinates, where the file states one.
    idle : IdleTurns, optional
        Rotations that nothing resists.
    turned : mapping of int to (3, 3) float64
        Axes, as rows, along which supports hold nodes whose rows are along the basic axes.
    means : mapping of int to (3,) float64
        Places at which nodes move that the solver, if it is CalculiX, lets follow the mean of others.
    """

    path: Path
    nodes: Nodes
    rows: Mapping[str, DofTable]
    sets: Mapping[str, DofTable] = field(default_factory=dict)
    constrained: DofTable | None = None
    files: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()
    node_sets: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)
    expanded: Mapping[int, tuple[int, ...]] = field(default_factory=dict)
    turning: Mapping[int, int] = field(default_factory=dict)
    length: StatedLength | None = None
    idle: IdleTurns | None = None
    turned: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)
    means: Mapping[int, NDArray[np.float64]] = field(default_factory=dict)

    @classmethod
    def of_mesh(cls, path: Path, nodes: Nodes, ids: NDArray[np.int64] | None = None) -> Geometry:
        """Geometry of a mesh, which defines no dof sets; rows are sorted by node, or have the order of some ids."""
        ids = np.sort(nodes.id) if ids is None else ids
        # In a plane body nodes move along x and y alone.
        plane = len(nodes) > 2 and not np.ptp(nodes.xyz[:, 2])
        rows = {name: rows_of_nodes(ids, count) for name, count in NODE_ROWS.items() if plane or name != "plane"}
        return cls(path, nodes, rows, files=(path,))

    def table(self, name: str) -> DofTable:
        """Dof table of a set that the user names.

        Raises
        ------
        DofMapError
            If there is no such set; the message lists those that exist.
        """
        for tables in (self.rows, self.sets):
            if name in tables:
                return tables[name]
        known = ", ".join(f"{key} ({len(table)})" for key, table in {**self.rows, **self.sets}.items())
        raise DofMapError(f"{self.path}: there is no dof set '{name}'; its sets and their sizes are {known}")


@dataclass(frozen=True)
class GeometryFormat:
    """A format of geometry files: decks, superelements and meshes.

    Parameters
    ----------
    name : str
        Key in the table of formats.
    words : str
        The format in words, for messages.
    detect : callable
        True for a file of this format, from text at its start. Formats earlier in the table come first.
    read : callable
        Geometry of a file.
    cells : callable
        Elements of a file, for pictures; empty where there are none.
    matrices : str
        How the program writes the matrices that belong to such a file, for messages.
    states : callable
        Mass and strain energy that the elements of a file state.
    length : callable
        Unit of the coordinates, from text at the start of a file; None where it states none.
    """

    name: str
    words: str
    detect: Callable[[str], bool]
    read: Callable[[Path], Geometry]
    cells: Callable[[Path], Cells]
    matrices: str = "name the file that has the stiffness and the mass"
    states: Statement = nothing_stated
    length: Callable[[str], StatedLength | None] = lambda head: None


def rows_of_nodes(ids: NDArray[np.int64], count: int) -> DofTable:
    """Components 1..count of every node."""
    return DofTable(np.repeat(ids, count), np.tile(np.arange(1, count + 1, dtype=np.int8), ids.size))


def cells_by_kind(cells: Iterable[tuple[str, list[int]]]) -> Cells:
    """Collect single cells by kind; cells that lack corners are left out."""
    found: dict[str, list[list[int]]] = {}
    for kind, nodes in cells:
        if len(nodes) == CELL_CORNERS[kind]:
            found.setdefault(kind, []).append(nodes)
    return {kind: np.array(nodes, dtype=np.int64) for kind, nodes in found.items()}
