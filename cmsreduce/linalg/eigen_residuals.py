"""What is left of the equation of motion of approximate modes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.block_lanczos import Operator
from cmsreduce.linalg.layout import by_rows
from cmsreduce.linalg.row_shares import share_rows

__all__ = ["eigen_residuals"]

# Rows that are worked on at a time.
_ROWS = 4096


def eigen_residuals(
    stiffness: Operator, mass: Operator, X: NDArray[np.float64], lam: NDArray[np.float64]
) -> NDArray[np.float64]:
    """K x - lam M x of each mode.

    Parameters
    ----------
    stiffness, mass : callable
        Products with K and M.
    X : (n, k) float64
        Modes.
    lam : (k,) float64
        Squared frequencies.

    Returns
    -------
    (n, k) float64
    """
    given = by_rows(X)
    residual, inertia = stiffness(given), mass(given)

    def work(_: int, rows: slice) -> None:
        residual[rows] -= inertia[rows] * lam

    share_rows(X.shape[0], _ROWS, work)
    return residual
