"""Grids inside a NASTRAN superelement: their motion by the recovery matrix MUG1, and their masses by the deck.

The matrices of a superelement do not say how mass moves with its generalised coordinates. Both together do.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import SCALAR, DofTable, FEModel, Nodes, Recovery, UntiedMass
from cmsreduce.read.matrix import matrix_names, read_matrix
from cmsreduce.read.nastran import grid_masses

__all__ = ["with_inner_grids"]

Array = NDArray[np.float64]

_DISPLACEMENTS = "MUG1"
_SIX = 6
_COMPONENTS = np.arange(1, _SIX + 1)
# Of the unit motion of a boundary dof, and of the mass of the superelement by that of all grids: numbers printed with
# ten digits, of which sums lose one.
_SAME = 1e-9


def with_inner_grids(body: FEModel, matrices: Path, deck: Path) -> tuple[FEModel, str]:
    """Give a superelement the motion and the mass of the grids inside it.

    Parameters
    ----------
    body : FEModel
        As read, with generalised coordinates.
    matrices : Path
        File of its stiffness, which may hold MUG1: displacements of grids under unit motion of each row.
    deck : Path
        Deck of the whole superelement, with its elements.

    Returns
    -------
    body : FEModel
        Grids without rows follow the rows (``tied``), and the mass is that of the grids (``untied_mass``); the body
        itself if the files do not give both.
    reason : str
        Reason why MUG1 is not used; empty if it is, or there is none.

    Notes
    -----
    M = T^T m T, T displacements of all grids, m their lumped masses, is compared with the mass of the superelement. It
    fails for another deck, for masses that are not lumped (COUPMASS), and where MUG1 lacks grids with mass.
    """
    if body.nodes is None or not (body.dofs.component == SCALAR).any():
        return body, ""
    names = [info.name for info in matrix_names(matrices) if info.name.upper() == _DISPLACEMENTS]
    if not names:
        return body, ""
    U = read_matrix(matrices, names[0]).A
    if U.shape[1] != body.n:
        return body, f"it has {U.shape[1]} columns, and the superelement {body.n} dofs"
    blocks = grid_masses(deck, body.nodes)
    if blocks is None:
        return body, (
            f"{deck} states no masses of grids, or has elements that are not counted; give the deck of the whole "
            "superelement as `geometry:`"
        )
    scale = np.sqrt(abs(body.M.diagonal()))
    scale[scale == 0] = 1.0
    worst = np.inf
    for points in _layouts(body, U.shape[0]):
        table = DofTable(np.repeat(points, _SIX), np.tile(_COMPONENTS, points.size))
        T = _by_rows(body, table, U)
        if T is None:
            continue
        grids = np.flatnonzero(body.nodes.index(table.node) >= 0)
        shapes, m = sp.csr_array(T[grids]), _nodal_mass(table[grids], body.nodes, blocks)
        differs = abs((shapes.T @ m @ shapes - body.M).toarray()) / np.outer(scale, scale)
        if (worst := min(worst, float(differs.max()))) <= _SAME:
            return _followed(body, table[grids], shapes, m), ""
    if not np.isfinite(worst):
        return (
            body,
            f"its {U.shape[0]} rows are not six for each grid of {deck}; ask for the displacements of all grids",
        )
    return body, (
        f"with the lumped masses of {deck} it gives a mass that differs from that of the superelement by {worst:.2g}; "
        "the deck is of another model, or its masses are not lumped (COUPMASS)"
    )


def _layouts(body: FEModel, rows: int) -> Iterator[NDArray[np.int64]]:
    """Points that the rows of MUG1 may be, six of each, sorted by number: grids, with or without scalar points."""
    assert body.nodes is not None
    scalar = body.dofs.node[body.dofs.component == SCALAR]
    for points in (body.nodes.id, np.concatenate([body.nodes.id, scalar])):
        if _SIX * points.size == rows:
            yield np.unique(points)


def _by_rows(body: FEModel, table: DofTable, U: sp.csc_array) -> sp.csr_array | None:
    """Displacements with a column for each row of the body; None if a boundary dof does not move as itself."""
    at = table.rows(body.dofs.node, body.dofs.component)
    seen = np.flatnonzero(at >= 0)
    own = sp.csr_array(U)[at[seen]].toarray()
    column = np.full(body.n, -1)
    column[seen] = abs(own).argmax(axis=1)
    unit = np.zeros_like(own)
    unit[np.arange(seen.size), column[seen]] = 1.0
    if np.unique(column[seen]).size < seen.size or abs(own - unit).max(initial=0.0) > _SAME:
        return None
    # Generalised coordinates without rows in the table have the other columns, in their order.
    column[column < 0] = np.setdiff1d(np.arange(body.n), column[seen])
    return sp.csr_array(sp.csc_array(U)[:, column])


def _nodal_mass(table: DofTable, nodes: Nodes, blocks: Array) -> sp.csc_array:
    """Masses of grids along their displacement frames; ``table`` has six dofs of each."""
    at = nodes.index(table.node[::_SIX])
    turned = np.kron(np.eye(2), np.ones((3, 3))) * np.tile(nodes.frame[at], (1, 2, 2))
    along = turned @ blocks[at] @ turned.transpose(0, 2, 1)
    mass = sp.csc_array(sp.bsr_array((along, np.arange(at.size), np.arange(at.size + 1))))
    mass.eliminate_zeros()
    return mass


def _followed(body: FEModel, table: DofTable, shapes: sp.csr_array, m: sp.csc_array) -> FEModel:
    """The body with the mass of all grids, whose dofs without rows follow its rows."""
    others = np.flatnonzero(body.dofs.rows(table.node, table.component) < 0)
    tied = Recovery(table[others], body.dofs, sp.csr_array(shapes[others]))
    return replace(body, tied=tied, untied_mass=UntiedMass(table, m))
