"""Whether the modes of a reduced body carry the momentum that its rigid mass says."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["momentum_balance"]

Array = NDArray[np.float64]


def momentum_balance(rigid_mass: Array, momentum: Array, rigid_count: int) -> tuple[float, float]:
    """Compare the momentum of a free body's modes with its rigid mass.

    Parameters
    ----------
    rigid_mass : (6, 6) float64
        R^T M R.
    momentum : (6, m) float64
        R^T M Phi, modes orthonormal in M, the rigid ones first.
    rigid_count : int
        Six for a body that is free in all directions.

    Returns
    -------
    rigid : float
        How far the rigid modes are from carrying all of the mass: |sum p p^T - R^T M R|, each entry relative to the
        roots of the diagonal entries it joins.
    elastic : float
        Largest momentum of any other mode, relative to the same roots; zero for a free body.

    Notes
    -----
    Rigid modes Phi_r = R T with T^T (R^T M R) T = 1, so that their momenta sum to R^T M R itself.
    Source: Hughes, J. Applied Mechanics 47 (1980).
    """
    root = np.sqrt(np.maximum(rigid_mass.diagonal(), 0.0))
    root = np.where(root > 0, root, 1.0)
    scaled = momentum / root[:, None]
    rigid, elastic = scaled[:, :rigid_count], scaled[:, rigid_count:]
    gap = rigid @ rigid.T - rigid_mass / np.outer(root, root)
    return float(abs(gap).max()), float(abs(elastic).max(initial=0.0))
