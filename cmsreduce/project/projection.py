"""What chosen modes of a system, in any number of configurations, ask of one body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["INDEPENDENT", "Projection", "project_shapes"]

INDEPENDENT = 1e-8
"""A direction of a body's projected shapes is one of its own when it holds more than this share of the amplitude of a
mode of the system of unit modal mass: 1e-16 of its kinetic energy. System modes are known to 1e-9 of theirs."""


@dataclass(frozen=True, eq=False)
class Projection:
    """The shapes of a body that span its part of chosen system modes.

    Parameters
    ----------
    body : str
        Name of the body.
    Q : (m, r) float64
        Shapes in the body's coordinates, orthonormal in its mass, the largest share first.
    singular : (k,) float64
        Singular values of all that was projected, in the body's mass norm, the largest first: the r kept and those
        taken for dependent. With system modes of unit modal mass they are amplitudes between 0 and the root of the
        number of modes, whatever the units.
    """

    body: str
    Q: NDArray[np.float64]
    singular: NDArray[np.float64]

    @property
    def rank(self) -> int:
        """Number of shapes kept, r."""
        return int(self.Q.shape[1])

    @property
    def left_out(self) -> float:
        """Largest singular value of what was left out; zero if nothing was."""
        return float(self.singular[self.rank :].max(initial=0.0))


def project_shapes(
    body: str,
    shapes: Sequence[NDArray[np.float64]],
    M: NDArray[np.float64],
    tolerance: float = INDEPENDENT,
) -> Projection:
    """Collect a body's part of system modes from several configurations, freed of what is dependent.

    Parameters
    ----------
    body : str
        Name of the body.
    shapes : sequence of (m, n_R) float64
        Chosen system modes in the body's coordinates, one block for each configuration; each mode of unit modal mass
        in the whole system.
    M : (m, m) float64 or (m,) float64
        Mass of the body, positive definite, or its diagonal.
    tolerance : float
        Singular values up to this are dependent. A larger one compresses: the chosen modes then no longer return
        exactly.

    Returns
    -------
    Projection

    Raises
    ------
    MatrixError
        If the mass is not positive definite.

    Notes
    -----
    The singular value decomposition U1 S1 V1^T of P_i Phi_R, U1 in the place of P_i Phi_R where that is deficient in
    rank: Eke and Man, AIAA 87; Bernard. The norm of the mass makes the decision independent of units and of the size
    of a system mode on the body: see theory section 6.
    """
    X = np.hstack([np.asarray(block, dtype=np.float64) for block in shapes])
    if M.ndim == 1:
        if not (M > 0).all():
            raise MatrixError(f"body '{body}': a projection is weighed by the mass, but a coordinate has none")
        root = np.sqrt(M)
        U, singular, _ = la.svd(root[:, None] * X, full_matrices=False)
        Q = U / root[:, None]
    else:
        try:
            R = la.cholesky((M + M.T) / 2)
        except la.LinAlgError:
            raise MatrixError(
                f"body '{body}': a projection is weighed by the mass, which is not positive definite; condense its "
                "massless coordinates first"
            ) from None
        U, singular, _ = la.svd(R @ X, full_matrices=False)
        Q = la.solve_triangular(R, U)
    rank = int(np.count_nonzero(singular > tolerance))
    return Projection(body, np.asarray(Q[:, :rank]), np.asarray(singular))
