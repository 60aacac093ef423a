"""Elastic flexibility of a body that is free to move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.sparse.factorisation import factorise
from cmsreduce.linalg.sparse.parts import part

__all__ = ["ElasticFlexibility", "Solve", "determinate_dofs"]

# Of dofs that a motion moves this nearly alike the first is taken: rounding of the motions must not choose.
_ALIKE = 1e-6

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Solves for one right-hand side (n,) or a block of right-hand sides (n, k)."""


def determinate_dofs(motions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Dofs that motions move independently, as many as there are: held there, a body is statically determinate.

    Parameters
    ----------
    motions : (n, r) float64
        Independent motions. The choice depends on their span alone.

    Returns
    -------
    (r,) int64
    """
    Q, _ = np.linalg.qr(motions / np.linalg.norm(motions, axis=0))
    chosen = np.empty(motions.shape[1], dtype=np.int64)
    for k in range(chosen.size):
        size = np.einsum("ij,ij->i", Q, Q)
        chosen[k] = np.argmax(size >= (1 - _ALIKE) * size.max())
        direction = Q[chosen[k]] / np.linalg.norm(Q[chosen[k]])
        Q = Q - np.outer(Q @ direction, direction)
    return chosen


class ElasticFlexibility:
    """Elastic flexibility P^T G P of a free body (theory section 2): a static solve without rigid motion.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, singular on ``rigid``, and mass.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    """

    def __init__(self, K: sp.csc_array, M: sp.csc_array, rigid: NDArray[np.float64]) -> None:
        self.rigid, self.momentum = rigid, M @ rigid
        self.free = np.setdiff1d(np.arange(rigid.shape[0]), determinate_dofs(rigid))
        self.factor = factorise(
            part(K, self.free), what="the stiffness held at a statically determinate set", kept=True
        )

    def __call__(self, f: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elastic displacement under a load, M-orthogonal to the rigid modes; (n,) or (n, k)."""
        load = f - self.momentum @ (self.rigid.T @ f)
        u = np.zeros_like(load)
        u[self.free] = self.factor(load[self.free])
        return np.asarray(u - self.rigid @ (self.momentum.T @ u))
