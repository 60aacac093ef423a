"""Whether a body is one piece."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model import FEModel

__all__ = ["check_connected", "parts"]

# Parts named in the message.
_NAMED = 5


def parts(body: FEModel) -> NDArray[np.int64]:
    """Number of the part each row belongs to; rows of one node are one part (n,)."""
    K, M = abs(body.K), abs(body.M)
    coupling = sp.coo_array(K + M)
    _, node = np.unique(body.dofs.node, return_inverse=True)
    graph = sp.csr_array(
        (np.ones(coupling.nnz), (node[coupling.row], node[coupling.col])), shape=(node.max() + 1, node.max() + 1)
    )
    _, label = csgraph.connected_components(graph, directed=False)
    return np.asarray(label[node], dtype=np.int64)


def check_connected(body: FEModel) -> None:
    """Refuse a body in several pieces, or with rows that have neither stiffness nor mass.

    Raises
    ------
    MatrixError
        Naming a node of every piece.
    """
    empty = np.flatnonzero((abs(body.K).sum(axis=0) == 0) & (abs(body.M).sum(axis=0) == 0))
    if empty.size:
        raise MatrixError(
            f"body '{body.name}': {empty.size} dofs have neither stiffness nor mass, the first is "
            f"{body.dofs.labels[empty[0]]}; write the analysis set without them (AUTOSPC), or take their rows out"
        )
    part = parts(body)
    count = int(part.max()) + 1
    if count > 1:
        sizes = np.bincount(part)
        order = np.argsort(-sizes)
        named = [
            f"{len(np.unique(body.dofs.node[part == p]))} nodes around node {body.dofs.node[part == p][0]}"
            for p in order[:_NAMED]
        ]
        raise MatrixError(
            f"body '{body.name}' is not one piece: {count} parts share neither stiffness nor mass "
            f"({'; '.join(named)}{' ...' if count > _NAMED else ''}). Look for missing elements or unmerged nodes, or "
            "make each part a component of its own"
        )
