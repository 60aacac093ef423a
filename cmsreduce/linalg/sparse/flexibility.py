"""Elastic flexibility of a body that is free to move."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.sparse.factorisation import factorise

__all__ = ["ElasticFlexibility", "Solve"]

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Solves for one right-hand side (n,) or a block of right-hand sides (n, k)."""


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
        n, r = rigid.shape
        self.rigid, self.momentum = rigid, M @ rigid
        # The rigid modes move r dofs independently: holding these makes the body statically determinate.
        _, _, order = la.qr(rigid.T, mode="economic", pivoting=True)
        self.free = np.setdiff1d(np.arange(n), order[:r])
        self.factor = factorise(
            sp.csc_array(K[self.free][:, self.free]), what="the stiffness held at a statically determinate set"
        )

    def __call__(self, f: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elastic displacement under a load, M-orthogonal to the rigid modes; (n,) or (n, k)."""
        load = f - self.momentum @ (self.rigid.T @ f)
        u = np.zeros_like(load)
        u[self.free] = self.factor(load[self.free])
        return np.asarray(u - self.rigid @ (self.momentum.T @ u))
