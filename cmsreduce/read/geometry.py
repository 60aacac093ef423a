"""The geometry file of a body, whatever program wrote it: nodes, and what the rows of its matrices may be."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.calculix_abaqus import is_abaqus_input, is_frd
from cmsreduce.read.mesh import read_mesh
from cmsreduce.read.nastran import KEY_STEP, SET_NAMES, BulkDeck, read_bulk, read_extseout, table_of_keys

__all__ = ["MESH_ROWS", "Geometry", "read_geometry"]

_HEAD = 1 << 20
_NASTRAN = re.compile(
    r"^\s{0,7}(GRID|GRDSET|SPOINT|CORD[12][RCS]|SECONCT|EXTRN|INCLUDE|CEND|SOL|BEGIN\s+(BULK|SUPER))(?=[\s,*=']|$)",
    re.IGNORECASE | re.MULTILINE,
)
_SUPERELEMENT = re.compile(r"^\s{0,7}(SECONCT|EXTRN)(?=[\s,*])", re.IGNORECASE | re.MULTILINE)
_CASE_CONTROL = re.compile(r"^\s{0,7}CEND\b", re.IGNORECASE | re.MULTILINE)
_TRANSLATIONS = "translations"
MESH_ROWS = {_TRANSLATIONS: 3, "six": 6}
"""Dofs at every node, sorted by node: what the rows of a matrix may be where there is no deck to say."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Nodes of a body and the dof tables its matrices may have.

    Parameters
    ----------
    path : Path
        File named by the user.
    nodes : Nodes
        Nodes in order of the file; none for a deck of scalar points.
    rows : mapping of str to DofTable
        What the rows of a matrix may be, the likeliest first, by name of the set.
    sets : mapping of str to DofTable
        Named dof sets, such as ``b`` and ``q``.
    constrained : DofTable, optional
        Dofs held at zero by the deck.
    files : tuple of Path
        Files read.
    remarks : tuple of str
        What the deck has that was not understood.
    """

    path: Path
    nodes: Nodes
    rows: Mapping[str, DofTable]
    sets: Mapping[str, DofTable] = field(default_factory=dict)
    constrained: DofTable | None = None
    files: tuple[Path, ...] = ()
    remarks: tuple[str, ...] = ()

    def table(self, name: str) -> DofTable:
        """Dof table of a set that the user names.

        Raises
        ------
        DofMapError
            Listing what there is.
        """
        for tables in (self.rows, self.sets):
            if name in tables:
                return tables[name]
        known = ", ".join(f"{key} ({len(table)})" for key, table in {**self.rows, **self.sets}.items())
        raise DofMapError(f"{self.path}: there is no dof set '{name}'; its sets and their sizes are {known}")


def read_geometry(path: Path) -> Geometry:
    """Read the geometry of a body; the format is found by content.

    Parameters
    ----------
    path : Path
        NASTRAN deck, external superelement (.asm or .pch), CalculiX .frd, Abaqus .inp, or a mesh.

    Returns
    -------
    Geometry

    Raises
    ------
    ReadError
        If the file is missing, damaged or of an unknown format.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD).decode("latin-1")
    except OSError as error:
        raise ReadError(f"{path}: the geometry cannot be read: {error.strerror or error}") from error
    binary = "\0" in head
    if binary or is_frd(head) or is_abaqus_input(head) or not _NASTRAN.search(head):
        nodes = read_mesh(path)
        return Geometry(path, nodes, _node_rows(nodes), files=(path,))
    # An assembly run names superelements as well, but it is a deck of its own.
    if _SUPERELEMENT.search(head) and not _CASE_CONTROL.search(head):
        found = read_extseout(path)
        return Geometry(path, found.nodes, {"a": found.dofs}, found.sets, files=found.files)
    return _of_deck(read_bulk(path))


def _of_deck(deck: BulkDeck) -> Geometry:
    """Sets of a deck that a matrix may be of; the analysis set first, as programs write it."""
    sizes = deck.sizes()
    rows: dict[str, DofTable] = {name: deck.dof_table(name) for name in ("a", "f", "n", "g") if name in sizes}
    free = np.setdiff1d(_keys(_node_rows(deck.nodes)[_TRANSLATIONS]), deck.constrained) if len(deck.nodes) else None
    if free is not None:
        rows[_TRANSLATIONS] = table_of_keys(free)
    sets = {name: deck.dof_table(name) for name in SET_NAMES if name in sizes}
    return Geometry(deck.path, deck.nodes, rows, sets, table_of_keys(deck.constrained), deck.files, deck.remarks)


def _keys(dofs: DofTable) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return dofs.node * KEY_STEP + dofs.component


def _node_rows(nodes: Nodes) -> dict[str, DofTable]:
    """Three or six dofs at every node, sorted by node."""
    ids = np.sort(nodes.id)
    return {
        name: DofTable(np.repeat(ids, count), np.tile(np.arange(1, count + 1, dtype=np.int8), ids.size))
        for name, count in MESH_ROWS.items()
    }
