"""Reassemble bodies reduced to a few shapes, by the true null space of their reduced constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.null_space import null_space

__all__ = ["Reassembled", "reassemble"]


@dataclass(frozen=True, eq=False)
class Reassembled:
    """Modes of the system that reduced bodies make.

    Parameters
    ----------
    squared : (N,) float64
        Squared natural frequencies in (rad/s)^2, ascending; round-off of zero for rigid motion.
    shapes : tuple of (m_i, N) float64
        Modes in the coordinates of each unreduced body, of unit modal mass in the system.
    constrained : int
        Rank of the reduced constraints A_R.
    """

    squared: NDArray[np.float64]
    shapes: tuple[NDArray[np.float64], ...]
    constrained: int


def reassemble(
    bodies: Sequence[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]],
    A: Sequence[NDArray[np.float64]],
) -> Reassembled:
    """Reduce each body to some shapes and join them again.

    Parameters
    ----------
    bodies : sequence of (M, K, Q)
        Mass and stiffness (m_i, m_i) of each body, and the shapes (m_i, r_i) it is reduced to.
    A : sequence of (c, m_i) float64
        Columns of the constraints A X = 0 of each body.

    Notes
    -----
    P_R spans null(A_R), A_R = [A_1 Q_1, A_2 Q_2, ...]: the closed formula published for it is not always of full rank
    (three disks with all modes kept: 4 x 4 of rank 3; theory section 6).
    """
    constraints = np.hstack([part @ Q for part, (_, _, Q) in zip(A, bodies, strict=True)])
    P, rank = null_space(constraints)
    M, K = (la.block_diag(*[Q.T @ body[k] @ Q for body in bodies for Q in [body[2]]]) for k in (0, 1))
    M, K = P.T @ M @ P, P.T @ K @ P
    squared, X = la.eigh((K + K.T) / 2, (M + M.T) / 2)
    ends = np.cumsum([Q.shape[1] for _, _, Q in bodies])[:-1]
    parts = np.split(P @ X, ends)
    return Reassembled(squared, tuple(Q @ q for (_, _, Q), q in zip(bodies, parts, strict=True)), rank)
