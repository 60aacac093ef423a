"""Rows of one component that are in another order in the mass than in the stiffness, such as one rotation of each node.

The other rows of their nodes still couple all pairs that the stiffness couples. These rows couple those around
another node.
"""

from __future__ import annotations

from typing import NoReturn

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import SCALAR, FEModel

__all__ = ["refuse_rows", "rows_among_others"]

Indices = NDArray[np.int64]

# Nodes that a row of a mass that elements spread couples; scalar masses between two dofs couple one.
_FEWEST = 2
_TRANSLATIONS = 3
_NAMED = 5
# Pairs of a row and a node that are looked at together.
_PAIRS = 10_000_000


def rows_among_others(
    M: sp.csc_array, component: NDArray[np.integer], node: Indices, around: sp.csr_array, share: float
) -> tuple[Indices, Indices]:
    """Rows of the mass that couple nodes farther away than the stiffness does.

    Parameters
    ----------
    M : (n, n) csc array
        Mass.
    component, node : (n,) int
        Component of each row, and the number of its node.
    around : (N, N) sparse array
        Pairs of nodes that the stiffness couples, of ones.
    share : float
        Entries below this share of the masses of both rows are rounding.

    Returns
    -------
    exchanged : (k,) int64
        Rows that couple the nodes around another node, whose row of this component does so, too.
    apart : (m,) int64
        Rows that do not couple all nodes around their own that other rows of it do, as those of a mass do that is
        spread over nodes beside the mass of the elements.
    """
    n, count = node.size, around.shape[0]
    own, column = np.sqrt(abs(M.diagonal())), np.repeat(np.arange(M.shape[0]), np.diff(M.indptr))
    firm = (M.indices != column) & (abs(M.data) > share * own[M.indices] * own[column])
    # Labels of rotations are in doubt where those of translations may be right.
    moving = component[M.indices] <= _TRANSLATIONS
    firm &= moving | (np.bincount(column[firm & moving], minlength=n) == 0)[column]
    S = sp.csr_array((np.ones(firm.sum(), np.int32), (column[firm], node[M.indices[firm]])), shape=(n, count))
    S.data[:] = 1
    near = sp.csr_array(around + sp.eye_array(count, dtype=np.int32, format="csr"))
    near.data[:] = 1
    many = np.diff(S.indptr)
    expected = np.asarray(S.multiply(near[node]).sum(axis=1)).ravel()
    # Without their own node, which rotations couple with translations and an axis along a bar does not.
    fitting = sp.csr_array(S.multiply(around[node]))
    by_any = sp.csr_array(sp.csr_array((np.ones(n, np.int32), (node, np.arange(n))), shape=(count, n)) @ fitting)
    # Rows beside others of their node that couple what the stiffness does.
    sound = np.bincount(node, expected > 0, count) > 0
    # Elements share mass along an axis at all nodes or none: where some rows have none, the others have added mass.
    lumped = np.unique(component[(many == 0) & sound[node] & (component <= _TRANSLATIONS)])
    alien = np.flatnonzero((many >= _FEWEST) & (expected < many) & sound[node] & (component != SCALAR))
    alien = alien[~np.isin(component[alien], lumped)]
    apart = alien[np.diff(fitting.indptr)[alien] < np.diff(by_any.indptr)[node[alien]]]
    if alien.size < _FEWEST:
        return alien[:0], apart
    own_place, cell = component[alien].astype(np.int64) * count + node[alien], component[alien].astype(np.int64) * count
    row, place = np.zeros(0, np.int64), np.zeros(0, np.int64)
    pairs = np.cumsum(S[alien] @ np.diff(near.indptr).astype(np.int64))
    for part in np.split(np.arange(alien.size), np.flatnonzero(np.diff(pairs // _PAIRS)) + 1):
        fits = sp.coo_array(S[alien[part]] @ near)
        whole = fits.data == many[alien[part[fits.row]]]
        at, to = part[fits.row[whole]], cell[part[fits.row[whole]]] + fits.col[whole]
        taken = np.isin(to, own_place)
        row, place = np.append(row, at[taken]), np.append(place, to[taken])
    # A row that took the place of another one left its own to a third.
    return np.asarray(alien[np.unique(row[np.isin(own_place[row], place)])]), apart


def refuse_rows(body: FEModel, rows: Indices) -> NoReturn:
    """Refuse a mass with rows among those of other nodes.

    Raises
    ------
    DofMapError
        Always; the message names the rows.
    """
    named = ", ".join(body.dofs.labels[k] for k in rows[:_NAMED])
    files = ", ".join(dict.fromkeys(source.path for source in body.sources if "mass" in source.holds))
    raise DofMapError(
        f"body '{body.name}': the rows of the mass matrix{files and f' ({files})'} are not in the order of the "
        f"stiffness: {rows.size} rows ({named}{' ...' if rows.size > _NAMED else ''}) have mass in common with the "
        "nodes around another node, and not with those around their own, as other rows of it have. Likely cause: rows "
        "of one component are in another order. Write both matrices from one run with one dof set, or label the rows "
        "of both files"
    )
