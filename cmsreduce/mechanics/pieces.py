"""Bodies in several pieces, and rows that share nothing with others or have neither stiffness nor mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model import SCALAR, FEModel

__all__ = ["check_connected", "parts", "rows_alone"]

# Rigid motions of a body that is free in all directions.
_ALL_MOTIONS = 6
# Parts named in a message.
_NAMED_PARTS = 5


def parts(body: FEModel) -> NDArray[np.int64]:
    """Number of the part of each row (n,); rows of one node are one part."""
    # Three partitions of the rows, whose classes are joined where they share a row: by K, by M, and by node.
    classes = [_connected(body.K), _connected(body.M), np.unique(body.dofs.node, return_inverse=True)[1]]
    starts = np.cumsum([0, *(label.max(initial=-1) + 1 for label in classes)])
    first = np.tile(classes[0], 2)
    second = np.concatenate([classes[1] + starts[1], classes[2] + starts[2]])
    shared = sp.coo_array((np.ones(first.size), (first, second)), shape=(starts[-1], starts[-1]))
    _, label = csgraph.connected_components(shared, directed=False)
    return np.asarray(label[classes[0]], dtype=np.int64)


def _connected(A: sp.csc_array) -> NDArray[np.int64]:
    """Number of the connected part of each row of a symmetric matrix (n,)."""
    if not A.data.all():
        A = A.copy()
        A.eliminate_zeros()
    # The transpose is the same matrix stored by rows. Its strong components need no second copy by columns.
    return np.asarray(csgraph.connected_components(A.T, directed=True, connection="strong")[1], dtype=np.int64)


def rows_alone(body: FEModel) -> tuple[NDArray[np.int64], str]:
    """Rows with a stiffness and a mass of their own and nothing beside them (k,), and words on them; empty without."""
    own = [(_entries(A) == 1) & (A.diagonal() > 0) for A in (body.K, body.M)]
    rows = np.flatnonzero(own[0] & own[1] & (body.dofs.component != SCALAR))
    if not rows.size:
        return rows, ""
    return rows, (
        f"{rows.size} rows have a stiffness and a mass of their own and share neither with others "
        f"({', '.join(body.dofs[rows[:_NAMED_PARTS]].labels)}{' ...' if rows.size > _NAMED_PARTS else ''}). If they "
        "are supports of which the program kept the diagonal (DIAG_KEEP of MFEM), write 1 there in both matrices "
        "(DIAG_ONE), or leave these rows out; the end of a straight bar, or a mass on a spring, is sound as it is"
    )


def check_connected(body: FEModel, proven: NDArray[np.float64] | None = None) -> None:
    """Refuse a body in several pieces, or with rows that have neither stiffness nor mass.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Its rigid motions, if K resists all others.

    Raises
    ------
    MatrixError
        Names a node of every piece.
    """
    # Each piece would have the rigid motions of its own nodes: three of one node, five or more of others.
    nodes, moving = body.dofs.node_ids.size, (body.dofs.component > 0) & (body.dofs.component <= 3)
    if proven is not None and proven.shape[1] == _ALL_MOTIONS and nodes > 2 and moving.sum() == 3 * nodes:
        return
    empty = np.flatnonzero((_entries(body.K) == 0) & (_entries(body.M) == 0))
    if empty.size:
        raise MatrixError(
            f"body '{body.name}': {empty.size} dofs have neither stiffness nor mass, the first is "
            f"{body.dofs.labels[empty[0]]}; write the matrices without them, or take their rows out"
        )
    part = parts(body)
    count = int(part.max()) + 1
    if count > 1 and all(np.array_equal(A.nonzero()[0], A.nonzero()[1]) for A in (body.K, body.M)):
        raise MatrixError(
            f"body '{body.name}': stiffness and mass are diagonal, {body.n} x {body.n}, so they are modal matrices and "
            "no dofs of nodes. Give them with their shapes: `modes: {stiffness: ..., mass: ..., shapes: ...}`"
        )
    if count > 1:
        sizes = np.bincount(part)
        order = np.argsort(-sizes)
        alone, why = rows_alone(body)
        if why and np.isin(np.flatnonzero(part != order[0]), alone).all():
            raise MatrixError(
                f"body '{body.name}' is not one piece: {why}. Make a mass that is meant a component of its own"
            )
        named = [
            f"{len(np.unique(body.dofs.node[part == p]))} nodes around node {body.dofs.node[part == p][0]}"
            for p in order[:_NAMED_PARTS]
        ]
        raise MatrixError(
            f"body '{body.name}' is not one piece: {count} parts share neither stiffness nor mass "
            f"({'; '.join(named)}{' ...' if count > _NAMED_PARTS else ''}). Look for missing elements or unmerged "
            "nodes, or make each part a component of its own"
        )


def _entries(A: sp.csc_array) -> NDArray[np.int64]:
    """Number of entries of each column that are not zero (n,)."""
    return np.diff(np.concatenate([[0], np.cumsum(A.data != 0)])[A.indptr])
