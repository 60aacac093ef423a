"""Entries of stiffness and mass against the elements of the deck, where these are solids whose program's rule is known.

Agreement of every entry of some rows proves these rows: their amounts, and their order. Other programs integrate by
other rules, so that a difference shows nothing.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Finding
from cmsreduce.pipeline.evidence.deck_agreement import EXACT, row_directions
from cmsreduce.read import SolidEntries, StatedMass, solid_masses, solid_stiffness

__all__ = ["ENTRIES", "mass_by_entries", "rows_by_entries"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

ENTRIES = "mass against the deck, each entry"
"""Name of the comparison of a mass."""

# Entries of elements that are added up at once, and of all elements of a stiffness that are.
_AT_ONCE, _MOST = 2_000_000, 30_000_000


def mass_by_entries(body: FEModel, stated: StatedMass) -> Finding | None:
    """Largest difference of an entry of the mass from the elements of the deck, if no entry differs.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    stated : StatedMass
        Masses and solids of its deck.

    Returns
    -------
    Finding or None
        Relative to the masses of both dofs. None if an entry differs, if other dofs than translations have mass, or if
        the deck has other elements.
    """
    assert body.nodes is not None
    rows = np.flatnonzero((body.dofs.component > 0) & (body.dofs.component <= 3))
    others = (body.dofs.component > 3) | (body.dofs.component < 0)
    entries = stated.entries
    if (
        not entries
        or any(not part.density > 0 for part in entries)
        or not rows.size
        or body.M.diagonal()[others].any()
        or stated.turning is not None
    ):
        return None
    xyz, count = body.nodes.xyz, len(body.nodes)
    made = sp.csr_array((count, count))
    for part in entries:
        size = part.nodes.shape[1]
        for some in _in_turn(np.arange(len(part.nodes)), size**2):
            at = part.nodes[some]
            first, second = np.repeat(at, size, axis=1).ravel(), np.tile(at, size).ravel()
            values = solid_masses(part, xyz, some).ravel()
            made = made + sp.csr_array((values, (first, second)), shape=made.shape)
    whole = sp.csr_array(sp.kron(made, sp.diags_array([1.0, 1, 1, 0, 0, 0])))
    if stated.points is not None:
        at = np.arange(count)
        whole = whole + sp.csr_array(sp.bsr_array((stated.points, at, np.append(at, count)), shape=whole.shape))
    off = _largest(body, body.M, rows, whole)
    return Finding(ENTRIES, off, EXACT) if off <= EXACT else None


def rows_by_entries(body: FEModel, entries: tuple[SolidEntries, ...], rows: Indices) -> bool:
    """True if all entries of some rows of the stiffness are those of the elements of the deck.

    Parameters
    ----------
    body : FEModel
        As read, with the deck's nodes.
    entries : tuple of SolidEntries
        All elements of its deck.
    rows : (k,) int64
        Rows of translations.
    """
    assert body.nodes is not None
    if not entries or not rows.size or any(np.isnan(part.G) for part in entries):
        return False
    if (body.dofs.component[rows] > 3).any() or (body.dofs.component[rows] < 1).any():
        return False
    count = len(body.nodes)
    wanted = np.zeros(count, dtype=bool)
    wanted[body.nodes.index(body.dofs.node[rows])] = True
    touching = [np.flatnonzero(wanted[part.nodes].any(axis=1)) for part in entries]
    if sum(one.size * 9 * part.nodes.shape[1] ** 2 for one, part in zip(touching, entries, strict=True)) > _MOST:
        return False
    made = sp.csr_array((6 * count, 6 * count))
    for part, one in zip(entries, touching, strict=True):
        size = 3 * part.nodes.shape[1]
        for some in _in_turn(one, size**2):
            at = (6 * part.nodes[some][:, :, None] + np.arange(3)).reshape(some.size, size)
            first, second = np.repeat(at, size, axis=1).ravel(), np.tile(at, size).ravel()
            kept = wanted[first // 6]
            values = solid_stiffness(part, body.nodes.xyz, some).ravel()
            made = made + sp.csr_array((values[kept], (first[kept], second[kept])), shape=made.shape)
    return _largest(body, body.K, rows, made) <= EXACT


def _in_turn(which: Indices, entries: int) -> list[Indices]:
    """Elements, so many at once that memory stays small."""
    return np.array_split(which, max(1, -(-which.size * entries // _AT_ONCE))) if which.size else []


def _largest(body: FEModel, A: sp.csc_array, rows: Indices, made: sp.csr_array) -> float:
    """Largest difference of an entry of some rows, relative to both diagonals; dofs inside elements are left out."""
    columns = np.flatnonzero(body.dofs.component > 0)
    own = np.sqrt(abs(A.diagonal()))
    # The matrices are symmetric: their columns are their rows.
    found = sp.csc_array(sp.csc_array(A[:, rows])[columns])
    stated = row_directions(body, columns) @ made.T @ row_directions(body, rows).T
    off = sp.coo_array(found - stated)
    scale = own[columns][off.row] * own[rows][off.col]
    relative = np.divide(abs(off.data), scale, out=np.where(off.data != 0, np.inf, 0.0), where=scale > 0)
    return float(relative.max(initial=0.0))
