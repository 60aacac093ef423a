"""Translations and rotations at the ends of bars, of the rows of a body."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Nodes, Recovery, cross_matrix

__all__ = ["end_motion"]

Array = NDArray[np.float64]


def end_motion(nodes: Nodes, ends: NDArray[np.int64], known: Recovery, offset: Array) -> sp.csr_array:
    """Motion of points that are fixed to nodes, x y z and rx ry rz along the basic axes, of the rows (6 k, n).

    Parameters
    ----------
    nodes : Nodes
        Nodes of the body.
    ends : (k,) int64
        Their ids, one for each point.
    known : Recovery
        Dofs and their motion; others stand still.
    offset : (k, 3) float64
        From each node to its point, basic axes: the point turns with the node.
    """
    node, component = np.repeat(ends, 6), np.tile(np.arange(1, 7), ends.size)
    found = known.dofs.rows(node, component)
    there = np.flatnonzero(found >= 0)
    frames = nodes.frame[nodes.index(node[there])]
    direction = frames[np.arange(there.size), (component[there] - 1) % 3]
    # Three rows of translations, then three of rotations, at each end.
    first = 6 * (there // 6) + 3 * ((there % 6) // 3)
    rows = first[:, None] + np.arange(3)
    to_basic = sp.csr_array(
        (direction.ravel(), (rows.ravel(), np.repeat(np.arange(there.size), 3))), shape=(6 * ends.size, there.size)
    )
    motion = sp.csr_array(to_basic @ known.T[found[there]])
    if offset.any():
        arm = np.tile(np.eye(6), (ends.size, 1, 1))
        arm[:, :3, 3:] = -cross_matrix(offset)
        k = ends.size
        motion = sp.csr_array(sp.bsr_array((arm, np.arange(k), np.arange(k + 1)), shape=(6 * k, 6 * k)) @ motion)
    motion.eliminate_zeros()
    return motion
