"""Bodies in several pieces, and rows that share nothing with others or have neither stiffness nor mass."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import absolute_product
from cmsreduce.model import DOUBLE, SCALAR, FEModel, rigid_body_shapes

__all__ = ["check_connected", "parts", "rows_alone"]

# Rigid motions of a body that is free in all directions.
_ALL_MOTIONS = 6
# A part that the ground holds has more energy in each motion than so many roundings of the terms that cancel in it.
_ROUNDINGS = 100.0
# Motions that differ by less, relative to the largest, are one.
_ALIKE = 1e-9
# A held node joins few parts; unmerged nodes leave thousands.
_MOST_PARTS = 100
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


def check_connected(body: FEModel, proven: NDArray[np.float64] | None = None) -> str:
    """Refuse a body in several pieces, or with rows that have neither stiffness nor mass.

    Pieces that the ground holds one by one are a sound body: a held node that is left out of the matrices joined them.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Its rigid motions, if K resists all others.

    Returns
    -------
    str
        Note on pieces that the ground holds; empty for a body in one piece.

    Raises
    ------
    MatrixError
        Names a node of every piece.
    """
    # Each piece would have the rigid motions of its own nodes: three of one node, five or more of others.
    nodes, moving = body.dofs.node_ids.size, (body.dofs.component > 0) & (body.dofs.component <= 3)
    if proven is not None and proven.shape[1] == _ALL_MOTIONS and nodes > 2 and moving.sum() == 3 * nodes:
        return ""
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
        order = np.argsort(-sizes, kind="stable")
        alone, why = rows_alone(body)
        if why and np.isin(np.flatnonzero(part != order[0]), alone).all():
            raise MatrixError(
                f"body '{body.name}' is not one piece: {why}. Make a mass that is meant a component of its own"
            )
        cuts = np.split(np.argsort(part, kind="stable"), np.cumsum(sizes)[:-1])
        rows = [cuts[p] for p in order]
        held = np.array([count <= _MOST_PARTS and _is_held(body, each) for each in rows])
        # Where the ground holds some of the parts, the others are at fault.
        fault = np.flatnonzero(held.all() | ~held)
        members = [body.dofs.node[rows[p]] for p in fault[:_NAMED_PARTS]]
        around = "; ".join(f"{len(np.unique(each))} nodes around node {each[0]}" for each in members)
        named = f"{around}{' ...' if len(fault) > _NAMED_PARTS else ''}"
        if held.all():
            return (
                f"{body.name}: the ground holds {count} parts of it one by one, which share neither stiffness nor mass "
                f"({named}). This is sound where they meet at a support that has no rows; else elements are missing"
            )
        free = f"; the ground does not hold {len(fault)} of them" if held.any() else ""
        raise MatrixError(
            f"body '{body.name}' is not one piece: {count} parts share neither stiffness nor mass{free} ({named}). "
            "Look for missing elements or unmerged nodes, or make each part a component of its own"
        )
    return ""


def _is_held(body: FEModel, rows: NDArray[np.int64]) -> bool:
    """True if the stiffness of some rows resists each rigid motion that moves them."""
    if body.nodes is None or (body.dofs.component[rows] == 0).any():
        return False
    dofs, K = body.dofs[rows], sp.csc_array(body.K[:, rows][rows])
    R = rigid_body_shapes(dofs, body.nodes, body.nodes.xyz[body.nodes.index(dofs.node)].mean(axis=0))
    parts = np.einsum("ij,ij->j", abs(R), absolute_product(K)(abs(R)))
    scaled = R[:, parts > 0] / np.sqrt(parts[parts > 0])
    # Rows along a line or in a plane show fewer motions.
    _, size, motions = np.linalg.svd(scaled, full_matrices=False)
    seen = scaled @ motions[size > _ALIKE * size.max(initial=0.0)].T
    least = np.linalg.eigvalsh(seen.T @ (K @ seen)).min(initial=np.inf)
    return bool(seen.shape[1] and least > _ROUNDINGS * max(body.stiffness_rounding, DOUBLE))


def _entries(A: sp.csc_array) -> NDArray[np.int64]:
    """Number of entries of each column that are not zero (n,)."""
    return np.diff(np.concatenate([[0], np.cumsum(A.data != 0)])[A.indptr])
