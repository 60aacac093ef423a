"""All normal modes below a frequency, counted before they are computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.factorise import NotPositiveDefiniteError, factorise
from cmsreduce.linalg.pencil import UndeterminedError, elastic_pairs
from cmsreduce.linalg.repeated import REPEATED, repeated_groups

__all__ = ["ElasticFlexibility", "modes_below", "sturm_count"]

# Up to this size all modes by dense algebra are quicker than a Lanczos run, and none can be missed.
_DENSE_LIMIT = 600
# A mode this close above the cutoff, relative to it, is at the cutoff and kept.
_AT_CUTOFF = 1e-9
# Modes asked for beyond those counted, more of them until all are found and the last repeated one is whole.
_EXTRA = (4, 16, 64, 256)
# A count steps over a mode that it hits by up to this share of its squared frequency.
_STEP = 1e-7
_STEPS = 6
# A mode is accepted when |K x - lam M x| is below this share of |K||x|, well above round-off, far below any use; or
# below what the rounding of the file leaves of K on rigid motion.
_RESIDUAL = 1e-9

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def sturm_count(K: sp.csc_array, M: sp.csc_array, omega: float) -> int:
    """Count modes below a frequency, from the inertia of K - omega^2 M (Sylvester's law).

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    omega : float
        Frequency in rad/s.

    Returns
    -------
    int
        Eigenvalues below omega^2, rigid modes included.
    """
    sigma = omega**2
    for attempt in range(_STEPS):
        # An exact hit on an eigenvalue, or an off-diagonal pivot, is stepped over by a hair.
        try:
            factor = factorise(sp.csc_array(K - sigma * (1 + attempt * _STEP) * M), definite=False)
        except NotPositiveDefiniteError:
            continue
        if factor.symmetric:
            return factor.negative_pivots
    raise MatrixError(
        f"the modes below {omega / 2 / np.pi:.6g} Hz cannot be counted: K - sigma M needs pivoting off the diagonal. "
        "Check the mass matrix for negative entries on its diagonal"
    )


class ElasticFlexibility:
    """Elastic flexibility of a free body, P^T G P (theory section 2): a solve in which rigid motion is absent.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness (singular on ``rigid``) and mass.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    """

    def __init__(self, K: sp.csc_array, M: sp.csc_array, rigid: NDArray[np.float64]) -> None:
        n, r = rigid.shape
        self.rigid, self.momentum = rigid, M @ rigid
        # r dofs that the rigid modes move independently hold the body in a statically determinate way.
        _, _, order = la.qr(rigid.T, mode="economic", pivoting=True)
        self.free = np.setdiff1d(np.arange(n), order[:r])
        self.factor = factorise(
            sp.csc_array(K[self.free][:, self.free]), what="the stiffness held at a statically determinate set"
        )

    def __call__(self, f: NDArray[np.float64]) -> NDArray[np.float64]:
        """Elastic displacement, M-orthogonal to the rigid modes, under a load; (n,) or (n, k)."""
        load = f - self.momentum @ (self.rigid.T @ f)
        u = np.zeros_like(load)
        u[self.free] = self.factor(load[self.free])
        return np.asarray(u - self.rigid @ (self.momentum.T @ u))


def modes_below(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    *,
    rigid: NDArray[np.float64] | None = None,
    solve: Solve | None = None,
    rounding: float = 2.0**-53,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """All elastic normal modes up to a frequency: not a fixed number, and none missing.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass; K definite apart from ``rigid``.
    omega : float
        Highest frequency in rad/s. A repeated mode at the cutoff is never split.
    rigid : (n, r) float64, optional
        Rigid-body modes of the pencil, orthonormal in M.
    solve : callable, optional
        Solves K x = b, where the factor is at hand (elastic flexibility for a free body).
    rounding : float
        Relative rounding of the entries of M, where they are printed with few digits.

    Returns
    -------
    w : (k,) float64
        Natural frequencies in rad/s, ascending.
    Phi : (n, k) float64
        Modes, orthonormal in M; the largest entry of each is positive.

    Raises
    ------
    UndeterminedError
        If a motion has neither mass nor stiffness.
    MatrixError
        If fewer modes converge than the Sturm count asks for, or a residual is too large.
    """
    n = K.shape[0]
    none = np.empty((n, 0)) if rigid is None else rigid
    top = omega * (1 + _AT_CUTOFF)
    if n <= _DENSE_LIMIT:
        try:
            lam, X = elastic_pairs(K.toarray(), M.toarray(), none, rounding)
        except UndeterminedError as error:
            row = int(np.argmax(abs(error.shape)))
            raise UndeterminedError(f"{error}; the first of them moves row {row + 1} above all", error.shape) from None
    else:
        if omega <= 0:
            return np.empty(0), np.empty((n, 0))
        # What repeats a mode at the cutoff is counted with it.
        reach = top * (1 + 2 * REPEATED)
        wanted = sturm_count(K, M, reach) - none.shape[1]
        if solve is None:
            solve = factorise(K, what="the stiffness") if not none.size else ElasticFlexibility(K, M, none)
        lam, X = _lanczos(K, M, solve, wanted, reach)
    w = np.sqrt(np.maximum(lam, 0.0))
    kept = int(np.count_nonzero(w <= top))
    if kept:
        group = repeated_groups(w)
        kept = int(np.count_nonzero(group <= group[kept - 1]))
    lam, X = lam[:kept], X[:, :kept]
    if lam.size:
        residual = np.linalg.norm(K @ X - (M @ X) * lam, axis=0)
        size = spla.norm(K, 1) * np.linalg.norm(X, axis=0)
        if (residual > max(_RESIDUAL, rounding) * size).any():
            worst = int(np.argmax(residual / size))
            raise MatrixError(
                f"mode {worst + 1} at {np.sqrt(lam[worst]) / 2 / np.pi:.6g} Hz did not converge: residual "
                f"{residual[worst] / size[worst]:.1e} of |K|; the matrices are too ill conditioned for this cutoff"
            )
    peak = X[abs(X).argmax(axis=0), np.arange(X.shape[1])] if lam.size else np.empty(0)
    return np.sqrt(lam), X * np.where(peak < 0, -1.0, 1.0)


def _lanczos(
    K: sp.csc_array, M: sp.csc_array, solve: Solve, wanted: int, omega: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    n = K.shape[0]
    inverse = spla.LinearOperator((n, n), matvec=lambda b: solve(np.ravel(b)), dtype=np.float64)
    start = solve(M @ np.random.default_rng(7).standard_normal(n))
    found = 0
    for extra in _EXTRA:
        k = min(wanted + extra, n - 2)
        lam, X = spla.eigsh(K, k=k, M=M, sigma=0.0, OPinv=inverse, v0=start, ncv=min(n - 1, max(2 * k + 1, 40)))
        order = np.argsort(lam)
        lam, X = lam[order], X[:, order]
        found = int(np.count_nonzero(lam <= omega**2 * (1 + _STEPS * _STEP)))
        group = repeated_groups(np.sqrt(np.maximum(lam, 0.0)))
        if found >= wanted and (not found or group[-1] > group[found - 1] or k == n - 2):
            X = X / np.sqrt(np.einsum("ij,ij->j", X, M @ X))
            return lam, X
    raise MatrixError(
        f"{wanted} modes lie below {omega / 2 / np.pi:.6g} Hz but {found} were found; lower the cutoff, or look for "
        "a part of the body that is nearly unconnected"
    )
