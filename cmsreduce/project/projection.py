"""What chosen modes of a system, in any number of configurations, ask of one body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.model import Matrix

__all__ = ["INDEPENDENT", "Projection", "project_shapes"]

INDEPENDENT = 1e-8
"""A direction of a body's projected shapes is one of its own when it holds more than this share of the amplitude of a
mode of the system of unit modal mass: 1e-16 of its kinetic energy. System modes are known to 1e-9 of theirs."""

# What Gram and Schmidt leave of a column that depends on those before it.
_ROUNDING = 1e-13


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
    M: Matrix,
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
    M : (m, m) float64 or sparse array
        Mass of the body; coordinates without mass follow the others.
    tolerance : float
        Singular values up to this are dependent. A larger one compresses: the chosen modes then no longer return
        exactly.

    Returns
    -------
    Projection

    Notes
    -----
    The singular value decomposition U1 S1 V1^T of P_i Phi_R, U1 in the place of P_i Phi_R where that is deficient in
    rank: Eke and Man; Bernard; theory section 6. The norm of the mass makes the decision independent of units and of
    the size of a system mode on the body. It is taken of the triangular factor of Gram and Schmidt in that norm: of the
    Gram matrix, values below 1e-8 would be round-off.
    """
    X = np.hstack([np.asarray(block, dtype=np.float64) for block in shapes])
    basis, R = _orthonormal(X, M)
    U, singular, _ = la.svd(R, full_matrices=False)
    rank = int(np.count_nonzero(singular > tolerance))
    return Projection(body, np.asarray(basis @ U[:, :rank]), np.asarray(singular))


def _orthonormal(X: NDArray[np.float64], M: Matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Columns orthonormal in M (m, r) and R (r, k) with X their product, by Gram and Schmidt twice over."""
    basis, of_mass, R = np.empty(X.shape), np.empty(X.shape), np.zeros((X.shape[1], X.shape[1]))
    r = 0
    for k in range(X.shape[1]):
        x = X[:, k].copy()
        for _ in range(2):
            c = of_mass[:, :r].T @ x
            x -= basis[:, :r] @ c
            R[:r, k] += c
        y = np.asarray(M @ x)
        size, whole = float(x @ y), float(np.sum(R[:r, k] ** 2))
        if size <= _ROUNDING**2 * whole or size <= 0:
            continue
        R[r, k] = np.sqrt(size)
        basis[:, r], of_mass[:, r] = x / R[r, k], y / R[r, k]
        r += 1
    return basis[:, :r], R[:r]
