"""Rigid motions of a body from three sources: its geometry, its stiffness, and its lowest modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.sparse import Factor, InsufficientMemoryError, factorise
from cmsreduce.model import FEModel

__all__ = ["RigidMotions", "rigid_motions"]

Array = NDArray[np.float64]

# Below this size the whole spectrum takes less time than a Lanczos run.
_DENSE_LIMIT = 600
# The pencil is shifted below zero by this share of the lowest elastic eigenvalue, as estimated by static deflection:
# small enough to separate rigid from elastic motion, large enough for the digits of the factor.
_SHIFT = 1e-2
# The shift is at least so many times the eigenvalue that the rounding of K may give a rigid motion.
_ABOVE_ROUNDING = 10.0
# Factors of the shift with which the raised stiffness is factorised, and whether it must be definite; one of these
# shifts is no eigenvalue.
_TRIED = ((1.0, True), (1.0, False), (2.0, False), (1e3, False))
# Elastic modes computed beside the rigid ones, to show the gap between them.
_BESIDE = 4


@dataclass(frozen=True, eq=False)
class RigidMotions:
    """The same r motions from three sources, each equal to the geometric ones at the reference dofs.

    Parameters
    ----------
    reference : (r,) int64
        Rows that hold the body, one for each motion.
    geometry : (n, r) float64
        From coordinates.
    stiffness : (n, r) float64
        From the stiffness: -K_oo^-1 K_or times the motion of the reference dofs.
    eigen : (n, r) float64
        Lowest modes of K and M, combined.
    rigid_hz : (r,) float64
        Frequencies of the lowest modes, negative where the squared one is; zero but for rounding.
    elastic_hz : float
        The next frequency above them.
    """

    reference: NDArray[np.int64]
    geometry: Array
    stiffness: Array
    eigen: Array
    rigid_hz: Array
    elastic_hz: float

    def apart(self, M: sp.csc_array) -> tuple[float, float]:
        """Distances of the motions from stiffness and from modes to the motions from geometry.

        Parameters
        ----------
        M : (n, n) sparse array
            Mass.

        Returns
        -------
        (stiffness, eigen)
            Largest |X - R|_M / |R|_M of any motion.
        """
        size = _in_mass(M, self.geometry)
        by = tuple(float((_in_mass(M, X - self.geometry) / size).max()) for X in (self.stiffness, self.eigen))
        return by[0], by[1]


def rigid_motions(body: FEModel, geometry: Array) -> RigidMotions:
    """Find the rigid motions of a body in three independent ways.

    Parameters
    ----------
    body : FEModel
        Free in r ways.
    geometry : (n, r) float64
        Its rigid motions from coordinates; each carries mass.

    Raises
    ------
    NotPositiveDefiniteError
        If K does not resist every other motion.
    MatrixError
        If its lowest modes cannot be computed.

    Notes
    -----
    The comparison of pyYeti's ``cbcheck``, for sparse matrices. Printed digits of K give rigid motions eigenvalues
    below zero, which a small shift does not lift. The modes are then found by Lanczos iterations, which need a regular
    raised stiffness, and no definite one.
    """
    K, M, r = body.K, body.M, geometry.shape[1]
    _, _, order = la.qr((geometry / np.linalg.norm(geometry, axis=0)).T, mode="economic", pivoting=True)
    reference, others = np.sort(order[:r]), np.sort(order[r:])
    if not others.size:
        # A point mass has no other motion.
        return RigidMotions(reference, geometry, geometry, geometry, np.zeros(r), float("inf"))
    at = geometry[reference]
    held = factorise(sp.csc_array(K[others][:, others]), what="the stiffness held at the reference dofs")
    stiffness = np.zeros_like(geometry)
    stiffness[reference] = at
    stiffness[others] = -held(np.asarray(K[others][:, reference] @ at))
    shift = max(
        _SHIFT * _lowest_elastic(K, M, geometry, held, others),
        _ABOVE_ROUNDING * _rounding_eigenvalue(K, M, geometry, body.rounding),
    )
    lam, X = _lowest_modes(K, M, shift, r)
    # Lowest modes that do not hold the reference dofs have no such combination; the nearest one shows how far they are.
    eigen = X[:, :r] @ np.linalg.lstsq(X[reference, :r], at)[0]
    hz = np.sign(lam) * np.sqrt(abs(lam)) / (2 * np.pi)
    return RigidMotions(reference, geometry, stiffness, eigen, hz[:r], float(hz[r]) if hz.size > r else float("inf"))


def _lowest_elastic(K: sp.csc_array, M: sp.csc_array, R: Array, held: Factor, others: NDArray[np.int64]) -> float:
    """Upper estimate of the lowest elastic eigenvalue: the softest deflection under the body's own inertia forces."""
    load = np.asarray(M @ R)
    # Random loads are added because inertia forces of a symmetric body may not excite its softest mode.
    rng = np.random.default_rng(1)
    loads = np.hstack([load, M @ rng.standard_normal(R.shape)])
    U = np.zeros((R.shape[0], loads.shape[1]))
    U[others] = held(loads[others])
    U -= R @ np.linalg.solve(R.T @ load, R.T @ (M @ U))
    stiffness, mass = np.einsum("ij,ij->j", U, K @ U), np.einsum("ij,ij->j", U, M @ U)
    good = (mass > 0) & (stiffness > 0)
    if not good.any():
        return float(abs(K.diagonal()).sum() / abs(M.diagonal()).sum())
    return float((stiffness[good] / mass[good]).min())


def _rounding_eigenvalue(K: sp.csc_array, M: sp.csc_array, R: Array, rounding: float) -> float:
    """Largest eigenvalue that a rigid motion has by the rounding of the entries of K, found and possible."""
    mass = np.einsum("ij,ij->j", R, M @ R)
    found = abs(np.einsum("ij,ij->j", R, K @ R))
    # Independent errors of the entries add up as their squares do.
    terms = np.sqrt(np.einsum("ij,ij->j", R**2, K.power(2) @ R**2))
    possible = max(rounding, float(np.finfo(np.float64).eps)) * terms
    return float((np.maximum(found, possible) / np.maximum(mass, np.finfo(np.float64).tiny)).max(initial=0.0))


def _lowest_modes(K: sp.csc_array, M: sp.csc_array, shift: float, r: int) -> tuple[Array, Array]:
    """Lowest eigenpairs of the pencil, ascending, with a few beyond the rigid ones."""
    n = K.shape[0]
    wanted = min(r + _BESIDE, n - 1)
    X = _definite_modes(K, M, shift, wanted) if n <= _DENSE_LIMIT else None
    for times, definite in _TRIED:
        if X is None:
            X = _nearest_modes(K, M, times * shift, wanted, definite=definite)
    if X is None:
        raise MatrixError(
            f"the lowest modes of the stiffness and the mass cannot be computed (shift {shift:.1e}): a motion has "
            "neither stiffness nor mass, or the entries have no common scale"
        )
    lam = np.einsum("ij,ij->j", X, K @ X) / np.einsum("ij,ij->j", X, M @ X)
    order = np.argsort(lam)
    return lam[order], X[:, order]


def _definite_modes(K: sp.csc_array, M: sp.csc_array, shift: float, wanted: int) -> Array | None:
    """Lowest modes by dense algebra; None if the raised stiffness is not positive definite."""
    n = K.shape[0]
    try:
        # In the inverted pencil dofs without mass have the eigenvalue zero, not infinity.
        X = la.eigh(M.toarray(), (K + shift * M).toarray(), subset_by_index=[n - wanted, n - 1])[1]
    except la.LinAlgError:
        return None
    return np.asarray(X)


def _nearest_modes(K: sp.csc_array, M: sp.csc_array, shift: float, wanted: int, *, definite: bool) -> Array | None:
    """Modes nearest to -shift; None if the raised stiffness has no such factor, or the iterations do not end."""
    n = K.shape[0]
    start = np.random.default_rng(1).standard_normal(n)
    try:
        solve = factorise(sp.csc_array(K + shift * M), definite=definite, what="the stiffness raised by mass")
        inverse = spla.LinearOperator((n, n), matvec=lambda b: solve(np.asarray(b).ravel()), dtype=np.float64)
        _, X = spla.eigsh(K, k=wanted, M=M, sigma=-shift, OPinv=inverse, v0=start)
    except (InsufficientMemoryError, MemoryError):
        raise
    except (MatrixError, ArithmeticError, la.LinAlgError, spla.ArpackError):
        return None
    return np.asarray(X) if np.isfinite(X).all() else None


def _in_mass(M: sp.csc_array, X: Array) -> Array:
    return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", X, M @ X), 0.0)))
