"""Highest frequency of a sparse pencil, which limits explicit steps in time."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import Factor, NotPositiveDefiniteError, factorise

__all__ = ["HighestFrequency", "highest_frequency"]

Array = NDArray[np.float64]
Motion = Callable[[Array], Array]

# Relative residual of an eigenvalue. Its frequency has half of this error at most, 4e-5 in a bar of solids: steps need
# no more digits, and 1e-6 takes more than twice as long.
_TOLERANCE = 1e-3
# Rows below which all eigenvalues are computed by dense algebra.
_DENSE = 300
_SEED = 3


class HighestFrequency(NamedTuple):
    """Highest frequency in rad/s, and the entries of the triangular factor of the mass."""

    omega: float
    factor_entries: int


def highest_frequency(K: sp.csc_array, M: sp.csc_array) -> HighestFrequency | None:
    """Highest natural frequency of K x = w^2 M x; rows without mass follow statically.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Symmetric, positive semidefinite.

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
    operator = _condensed(K, massive, massless, held)
    n = massive.size
    if n <= _DENSE:
        squares = np.linalg.eigvals(mass(operator(np.eye(n)))).real
        return HighestFrequency(float(np.sqrt(max(squares.max(), 0.0))), mass.cost.nnz)
    start = np.random.default_rng(_SEED).standard_normal(n)
    (largest,) = spla.eigsh(
        spla.LinearOperator((n, n), matvec=operator, dtype=np.float64),
        k=1,
        M=sp.csc_array(M[massive][:, massive]),
        Minv=spla.LinearOperator((n, n), matvec=mass, dtype=np.float64),
        which="LA",
        v0=start,
        tol=_TOLERANCE,
        return_eigenvectors=False,
    )
    return HighestFrequency(float(np.sqrt(max(largest, 0.0))), mass.cost.nnz)


def _condensed(K: sp.csc_array, massive: NDArray[np.int64], massless: NDArray[np.int64], held: Factor | None) -> Motion:
    """Stiffness of the rows with mass, the others in equilibrium, as a function of motions."""
    own = sp.csr_array(K[massive][:, massive])
    if held is None:
        return lambda x: np.asarray(own @ x)
    across = sp.csr_array(K[massive][:, massless])
    back = sp.csr_array(across.T)
    return lambda x: np.asarray(own @ x - across @ held(np.asarray(back @ x)))
