"""Highest frequency of a system, or the size of a faster root, which limits explicit steps in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import Factor, NotPositiveDefiniteError, factorise

__all__ = ["HighestFrequency", "fastest_root", "highest_frequency"]

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]

# Relative residual of an eigenvalue. Its frequency has half of this error at most, 4e-5 in a bar of solids: steps need
# no more digits, and 1e-6 takes more than twice as long.
_TOLERANCE = 1e-3
# Rows below which all eigenvalues are computed by dense algebra.
_DENSE = 300
_SEED = 3
# Damping and gyroscopic forces below this share of the highest frequency raise no root above it by more than 5 %.
_SLOW = 0.1


class HighestFrequency(NamedTuple):
    """Highest frequency in rad/s, and the entries of the triangular factor of the mass."""

    omega: float
    factor_entries: int


def fastest_root(omega: Array, D: Array) -> float:
    """Highest frequency of modes in rad/s, or the size of a faster root: a nutation, or the decay of a strong damper.

    Parameters
    ----------
    omega : (k,) float64
        Frequencies of modes of unit mass in rad/s; zero for rigid motions.
    D : (k, k) float64
        Their damping and gyroscopic forces.
    """
    highest = float(omega.max(initial=0.0))
    # The largest singular value is no larger than this mean, which takes no time.
    if not D.size or np.sqrt(la.norm(D, 1) * la.norm(D, np.inf)) <= _SLOW * highest:
        return highest
    if (strongest := float(la.norm(D, 2))) <= _SLOW * highest:
        return highest
    k, scale = omega.size, max(highest, strongest)
    if k > _DENSE:
        return max(highest, _fastest(lambda x: omega**2 * x, lambda x: D @ x, scale, k))
    # Amplitudes times a frequency, and rates.
    A = np.block([[np.zeros((k, k)), scale * np.eye(k)], [-np.diag(omega**2) / scale, -D]])
    return max(highest, float(abs(np.linalg.eigvals(A)).max()))


def _fastest(stiffness: Motion, drag: Motion, scale: float, n: int, near: Array | None = None) -> float:
    """Size of the fastest root of x'' + drag x' + stiffness x = 0 in n coordinates, from a shape near its own."""

    def rate(x: Array) -> Array:
        return np.concatenate([scale * x[n:], -stiffness(x[:n]) / scale - drag(x[n:])])

    start = np.random.default_rng(_SEED).standard_normal(2 * n)
    if near is not None:
        # A damper elsewhere may have the fastest root: other shapes keep a share.
        start = start * la.norm(near) / la.norm(start) + np.concatenate([near, -near])
    roots = spla.eigs(
        spla.LinearOperator((2 * n, 2 * n), matvec=rate, dtype=np.float64),
        k=2,
        which="LM",
        v0=start,
        tol=_TOLERANCE,
        return_eigenvectors=False,
    )
    return float(abs(roots).max())


def highest_frequency(K: sp.csc_array, M: sp.csc_array, D: sp.csc_array | None = None) -> HighestFrequency | None:
    """Highest natural frequency of K x = w^2 M x, or the size of a faster root; rows without mass follow statically.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Symmetric, positive semidefinite.
    D : (n, n) sparse array, optional
        Damping and gyroscopic forces.

    Returns
    -------
    HighestFrequency or None
        None if the mass is singular beyond rows that are zero: then a motion without mass has no highest frequency.
    """
    K, M = sp.csc_array(K), sp.csc_array(M)
    massive = np.flatnonzero(abs(M).sum(axis=0) > 0)
    massless = np.setdiff1d(np.arange(M.shape[0]), massive)
    if not massive.size:
        return HighestFrequency(0.0, 0)
    try:
        mass = factorise(sp.csc_array(M[massive][:, massive]), what="the mass matrix")
        held = factorise(sp.csc_array(K[massless][:, massless]), what="the massless part") if massless.size else None
    except NotPositiveDefiniteError:
        return None
    operator, drag = (None if A is None else _condensed(sp.csc_array(A), K, massive, massless, held) for A in (K, D))
    assert operator is not None
    n = massive.size
    if n <= _DENSE:
        one = np.eye(n)
        squares, X = la.eigh(operator(one), M[massive][:, massive].toarray())
        omega = np.sqrt(np.maximum(squares, 0.0))
        top = float(omega.max()) if drag is None else fastest_root(omega, X.T @ drag(X))
        return HighestFrequency(top, mass.cost.nnz)
    squares, X = spla.eigsh(
        spla.LinearOperator((n, n), matvec=operator, dtype=np.float64),
        k=1,
        M=sp.csc_array(M[massive][:, massive]),
        Minv=spla.LinearOperator((n, n), matvec=mass, dtype=np.float64),
        which="LA",
        v0=np.random.default_rng(_SEED).standard_normal(n),
        tol=_TOLERANCE,
    )
    highest = float(np.sqrt(max(squares[0], 0.0)))
    if drag is not None:
        highest = max(highest, _fastest(lambda x: mass(operator(x)), lambda x: mass(drag(x)), highest, n, X[:, 0]))
    return HighestFrequency(highest, mass.cost.nnz)


def _condensed(
    A: sp.csc_array, K: sp.csc_array, massive: NDArray[np.int64], massless: NDArray[np.int64], held: Factor | None
) -> Motion:
    """T^T A T as a function of motions of the rows with mass; T: the others in equilibrium under K."""
    own = sp.csr_array(A[massive][:, massive])
    if held is None:
        return lambda x: np.asarray(own @ x)
    every = sp.csr_array(A)
    back = sp.csr_array(K[massless][:, massive])

    def condensed(x: Array) -> Array:
        moved = np.zeros((A.shape[0], *x.shape[1:]))
        moved[massive], moved[massless] = x, -held(np.asarray(back @ x))
        force = every @ moved
        return np.asarray(force[massive] - back.T @ held(force[massless]))

    return condensed
