"""Places of all nodes by the motions that a stiffness matrix leaves without force, in whatever order its rows are.

The six motions of a free body move each point by a translation and by a turn across its arm. Up to a change of the
axes of the turn they show the arm of every node. These places, beside those of the geometry, show the order.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import DofTable, FEModel, Nodes

__all__ = ["other_labels"]

Array = NDArray[np.float64]

_MOTIONS, _TURNS = 6, 3
# A factor of so many dofs takes a few seconds.
_MOST_DOFS = 150_000
# Raises the scaled stiffness, so that it has a factor; steps of inverse iteration with two columns more than motions.
_RAISED, _STEPS, _COLUMNS = 1e-8, 6, 8
# Energy of the motions relative to that of the next one; what a motion has beyond six, or an arm beyond a turn.
_APART, _SMALL = 1e-4, 1e-5
# Places that are the same, relative to the size of the body.
_SAME = 1e-4


def other_labels(body: FEModel, nodes: Nodes) -> list[tuple[DofTable, str]]:
    """Labels of the rows by the places of the nodes in the matrix, and what they say of the labels that were given.

    A symmetric body has several; axes or nodes alone are first, then those that change the fewest nodes. There are
    none for a body that has not six motions, or nodes without rows along all axes.
    """
    ids = body.dofs.node_ids
    rows = body.dofs.rows(ids[:, None], np.arange(1, 4)).reshape(-1, 3)
    if ids.size < _TURNS or body.n > _MOST_DOFS or (rows < 0).any():
        return []
    motions = _motions(body.K)
    at = nodes.index(ids)
    # The rows are along the axes of the nodes that they are labelled with.
    arms = None if motions is None else _arms(np.einsum("nki,nka->nia", nodes.frame[at], motions[rows]))
    if arms is None:
        return []
    given = nodes.xyz[at] - nodes.xyz[at].mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum(given**2, axis=1))))
    arms *= size / np.sqrt(np.mean(np.sum(arms**2, axis=1)))
    # Imported here: it loads libraries that only refusals need.
    from scipy.spatial import KDTree

    tree, labels = KDTree(given), []
    for axes in permutations(range(3)):
        for sign in (1.0, -1.0):
            away, found = tree.query(sign * arms[:, axes])
            nearest = np.asarray(found)
            if np.max(away) > _SAME * size or np.unique(nearest).size < ids.size:
                continue
            moved = np.flatnonzero(nearest != np.arange(ids.size))
            of = nearest[np.searchsorted(ids, body.dofs.node)]
            component, true = body.dofs.component.copy(), np.argsort(axes)
            for first in (0, 3):
                own = (component > first) & (component <= first + 3)
                # The row of an axis is that of another one.
                component[own] = first + 1 + true[component[own] - first - 1]
            said = []
            if axes != (0, 1, 2):
                said.append(f"the rows have the axes {', '.join('xyz'[k] for k in true)} in place of x, y, z")
            if moved.size:
                k = moved[0]
                said.append(
                    f"the rows of {moved.size} nodes are in another order: those labelled node {ids[k]} are of node "
                    f"{ids[nearest[k]]}"
                )
            if said:
                labels.append(((len(said), moved.size), DofTable(ids[of], component), "; ".join(said)))
    return [(dofs, said) for _, dofs, said in sorted(labels, key=lambda each: each[0])]


def _motions(K: sp.csc_array) -> Array | None:
    """The six motions (n, 6) that cost no force; None if there are more or fewer."""
    scale = np.sqrt(abs(K.diagonal()))
    if not (scale > 0).all():
        return None
    S = sp.diags_array(1 / scale)
    A = sp.csc_array(S @ K @ S)
    X = np.random.default_rng(0).standard_normal((K.shape[0], _COLUMNS))
    try:
        factor = factorise(sp.csc_array(A + _RAISED * sp.eye_array(K.shape[0])), what="the raised stiffness")
    except MatrixError:
        return None
    for _ in range(_STEPS):
        X = np.linalg.qr(factor(X))[0]
    energy, V = np.linalg.eigh(X.T @ (A @ X))
    if abs(energy[:_MOTIONS]).max() > _APART * energy[_MOTIONS]:
        return None
    return np.asarray((X @ V[:, :_MOTIONS]) / scale[:, None])


def _arms(moved: Array) -> Array | None:
    """Arms of nodes (N, 3), times a factor, from six motions (N, 3, 6); None if these do not turn a rigid body."""
    turns = (moved - moved.mean(axis=0)).reshape(-1, _MOTIONS)
    u, s, _ = np.linalg.svd(turns, full_matrices=False)
    # Less their means, translations vanish.
    if s[_TURNS] > _SMALL * s[_TURNS - 1]:
        return None
    Q = u[:, :_TURNS].reshape(-1, 3, _TURNS)
    # Turns about the right axes C move each node by a skew matrix of its arm.
    parts = np.einsum("nik,jl->nijkl", Q, np.eye(3)).reshape(-1, 3, 3, 9)
    _, s, vt = np.linalg.svd((parts + parts.transpose(0, 2, 1, 3)).reshape(-1, 9), full_matrices=False)
    if s[-1] > _SMALL * s[-2]:
        return None
    spin = Q @ vt[-1].reshape(3, 3)
    return np.stack([spin[:, 1, 2], spin[:, 2, 0], spin[:, 0, 1]], axis=1)
