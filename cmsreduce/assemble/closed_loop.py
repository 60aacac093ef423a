"""Modes of an assembled system under feedback from its sensors to its actuators."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.dense import dense
from cmsreduce.model import System

__all__ = ["closed_loop_modes"]

# The state matrix has (2 N)^2 entries, of which all eigenvalues are computed.
_LARGEST = 1500
# A root of this size, relative to the highest frequency, is rigid motion that no feedback holds: twice zero, it is
# known to the root of rounding only.
_AT_REST = 1e-6


def closed_loop_modes(
    system: System, gain: NDArray[np.float64], omega: float
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Roots and shapes of M x'' + D x' + K x = B u with u = -gain y, y = C1 x + C2 x'.

    Parameters
    ----------
    system : System
        Reduced; every coordinate has mass.
    gain : (inputs, outputs) float64
        Feedback gain.
    omega : float
        Roots up to this size in rad/s are given, motion at rest left out.

    Returns
    -------
    s : (k,) complex128
        Roots in rad/s by size, one of each conjugate pair, the one above the real axis.
    X : (N, k) complex128
        Displacements, x(t) = X exp(s t), x^H M x = 1.

    Raises
    ------
    MatrixError
        If the system is too large for a dense state matrix, has massless coordinates, or a complex stiffness.
    """
    n = system.N
    if n > _LARGEST:
        raise MatrixError(
            f"modes under feedback are those of a reduced system; this one has {n} coordinates, more than {_LARGEST}: "
            "take `of: reduced`, or fewer modes of the bodies"
        )
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no modes in time; use modal damping")
    M, K = dense(system.M), dense(system.K)
    D = np.zeros_like(M) if system.D is None else dense(system.D)
    try:
        R = la.cholesky(M)
    except la.LinAlgError:
        raise MatrixError(
            "modes under feedback need a mass for every coordinate; static modes have none: take a mode set without "
            "them, or no feedback"
        ) from None

    def balanced(A: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(la.solve_triangular(R, la.solve_triangular(R, A, trans="T").T, trans="T").T)

    stiff = balanced(K + system.B @ gain @ system.C1)
    damped = balanced(D + system.B @ gain @ system.C2)
    # Rates are counted in units of the highest frequency, so that both halves of the state are alike.
    A = np.block([[np.zeros((n, n)), omega * np.eye(n)], [-stiff / omega, -damped]])
    s, Z = la.eig(A)
    chosen = np.flatnonzero((abs(s) <= omega) & (abs(s) > _AT_REST * omega) & (s.imag >= 0))
    chosen = chosen[np.argsort(abs(s[chosen]), kind="stable")]
    X = la.solve_triangular(R, Z[:n, chosen])
    size = np.linalg.norm(Z[:n, chosen], axis=0)
    return s[chosen], np.asarray(X / np.where(size > 0, size, 1.0))
