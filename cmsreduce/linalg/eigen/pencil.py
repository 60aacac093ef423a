"""Which natural frequencies are one frequency, repeated.

Eigenpairs of small dense symmetric pencils, accurate at both ends of the spectrum.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = [
    "REPEATED",
    "UndeterminedError",
    "elastic_and_massless",
    "elastic_pairs",
    "orthonormal",
    "refine",
    "repeated_groups",
    "split_massless",
]

REPEATED = 1e-6
"""Frequencies this close, relative to them, belong to one repeated mode: a mesh keeps a symmetry no better."""


def repeated_groups(omega: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the groups of repeated frequencies.

    Modes of one group span one subspace, in which any rotation is as good.

    Parameters
    ----------
    omega : (e,) float64
        Frequencies.

    Returns
    -------
    (e,) int64
        Group of each mode, counted from 0 in order of frequency; a mode by itself is a group of one.

    Examples
    --------
    >>> repeated_groups(np.array([1.0, 2.0, 2.0 + 1e-9, 3.0])).tolist()
    [0, 1, 1, 2]
    """
    order = np.argsort(omega, kind="stable")
    w = omega[order]
    group = np.zeros(omega.size, dtype=np.int64)
    group[order[1:]] = np.cumsum(w[1:] > w[:-1] * (1 + REPEATED))
    return group


# A first-order step is trusted where it rotates two modes by less than this; closer modes are one cluster, which is
# solved as a small pencil of its own.
_TRUSTED = 1e-4
# A shape's energy below this many roundings of its own terms is cancellation: the shape has no mass, or no stiffness.
# The first factor is for what arithmetic leaves, the second for what the file leaves: its rounding is relative to the
# decade of a number.
_LEFT_BY_ARITHMETIC = 20.0
_LEFT_BY_FILE = 10.0
# Beyond this share a negative kinetic energy is no cancellation.
_NEGATIVE = 1e-6


class UndeterminedError(MatrixError):
    """A motion with neither mass nor stiffness, which no equation determines; ``shape`` (m,) is one."""

    def __init__(self, message: str, shape: NDArray[np.float64]) -> None:
        super().__init__(message)
        self.shape = shape


def refine(
    K: NDArray[np.float64], M: NDArray[np.float64], lam: NDArray[np.float64], X: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One Newton step on approximate eigenpairs, which squares their error.

    Parameters
    ----------
    K, M : (m, m) float64
        Symmetric pencil.
    lam : (p,) float64
        Approximate eigenvalues.
    X : (m, p) float64
        Approximate eigenvectors, nearly orthonormal in M.

    Returns
    -------
    lam : (p,) float64
        Rayleigh quotients of the improved vectors.
    X : (m, p) float64
        Improved vectors.

    Notes
    -----
    Source: Ogita and Aishima, Japan J. Indust. Appl. Math. 35 (2018), 1007-1035, with M as inner product.
    """
    # Symmetric to the last digit: the gap of a close pair would make a shear of what rounding leaves of a rotation.
    R = np.eye(lam.size) - _symmetric(X.T @ M @ X)
    S = _symmetric(X.T @ K @ X)
    gap = lam[None, :] - lam[:, None]
    step = S + R * lam[None, :]
    near = np.maximum(abs(step), abs(step.T)) >= _TRUSTED * abs(gap)
    E = np.where(near, R / 2, step / np.where(near, 1.0, gap))
    X = X + X @ E
    np.fill_diagonal(near, False)
    clusters, label = csgraph.connected_components(near, directed=False)
    for number in np.flatnonzero(np.bincount(label, minlength=clusters) > 1):
        own = np.flatnonzero(label == number)
        x = X[:, own]
        X[:, own] = x @ la.eigh(_symmetric(x.T @ K @ x), _symmetric(x.T @ M @ x))[1]
    weight = np.einsum("ij,ij->j", X, M @ X)
    return np.einsum("ij,ij->j", X, K @ X) / weight, X / np.sqrt(weight)


def elastic_pairs(
    K: NDArray[np.float64],
    M: NDArray[np.float64],
    rigid: NDArray[np.float64],
    rounding: float = 2.0**-53,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """All finite elastic eigenpairs of a dense pencil; see `elastic_and_massless`.

    Returns
    -------
    lam : (p,) float64
        Squared frequencies, ascending.
    X : (m, p) float64
        Modes.
    """
    lam, X, _ = elastic_and_massless(K, M, rigid, rounding)
    return lam, X


def elastic_and_massless(
    K: NDArray[np.float64],
    M: NDArray[np.float64],
    rigid: NDArray[np.float64],
    rounding: float = 2.0**-53,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """All elastic modes of a dense pencil whose rigid modes are known: of finite frequency, and massless.

    Shapes without mass are condensed statically first, so that none of them becomes a large eigenvalue made of
    round-off. The pencil is turned over, M x = mu K x, so that soft modes keep their relative accuracy. It is
    solved on the M-orthogonal complement of the rigid modes, so that no shift enters the elastic ones.

    Parameters
    ----------
    K, M : (m, m) float64
        Stiffness, mass: symmetric, positive semidefinite.
    rigid : (m, r) float64
        Modes on which K vanishes, orthonormal in M.
    rounding : float
        Relative rounding of the entries of K and M, where they are printed with few digits.

    Returns
    -------
    lam : (p,) float64
        Squared frequencies, ascending, p = m - r - s.
    X : (m, p) float64
        Modes, orthonormal in M and M-orthogonal to ``rigid``.
    N : (m, s) float64
        Massless shapes, orthonormal in K, orthogonal in K and M to all others: they follow their load at once.

    Raises
    ------
    UndeterminedError
        If a shape has neither mass nor stiffness.
    MatrixError
        If K is singular beyond ``rigid``, or M gives a shape negative mass.
    """
    if K.shape[0] == 0:
        return np.empty(0), np.empty((0, 0)), np.empty((0, 0))
    r = rigid.shape[1]
    T, weight, N = split_massless(K, M, rounding)
    # In coordinates along T the mass is diagonal, and rigid motion is M-orthogonal to the columns of Z.
    Q, _ = la.qr(T.T @ (M @ rigid)) if r else (np.eye(weight.size), None)
    Z = Q[:, r:]
    try:
        mu, Y = la.eigh(_symmetric(Z.T @ (weight[:, None] * Z)), _symmetric(Z.T @ (T.T @ K @ T) @ Z))
    except la.LinAlgError:
        raise MatrixError("the stiffness is singular beyond the rigid-body modes: a mechanism is left") from None
    mu, ZY = mu[::-1], Z @ Y[:, ::-1]
    # Below the rounding of the largest an eigenvalue may have either sign, while a sum of positive parts cannot.
    lost = mu <= np.finfo(float).eps * mu.max(initial=0.0)
    mu = np.where(lost, np.einsum("ij,i,ij->j", ZY, weight, ZY), mu)
    lam, X = 1 / mu, T @ ZY / np.sqrt(mu)
    for _ in range(2):
        X -= rigid @ (rigid.T @ (M @ X))
        lam, X = refine(K, M, lam, X)
    order = np.argsort(lam, kind="stable")
    return lam[order], X[:, order], N


def split_massless(
    K: NDArray[np.float64], M: NDArray[np.float64], rounding: float = 2.0**-53
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Split the coordinates of a pencil into shapes that carry mass and shapes that carry none.

    A shape is massless if its kinetic energy is nothing but rounding of its terms; a mass may be as small as it likes.

    Parameters
    ----------
    K, M : (m, m) float64
        Stiffness, mass: symmetric, positive semidefinite.
    rounding : float
        Relative rounding of their entries.

    Returns
    -------
    T : (m, p) float64
        Shapes with mass, orthogonal in M, which the massless ones follow statically: T^T K N = 0.
    weight : (p,) float64
        Their masses, positive.
    N : (m, s) float64
        Massless shapes, orthonormal in K.

    Raises
    ------
    UndeterminedError
        If K is singular on the massless shapes.
    MatrixError
        If M gives a shape negative mass.
    """
    # Unit diagonal of M, so that coordinates of unlike units mix without loss of digits; but a mass that rounding of a
    # displacement leaves, whose frequency no double could hold beside the others, is none.
    least = (_LEFT_BY_ARITHMETIC * float(np.finfo(float).eps)) ** 2 * float(np.trace(M)) / (float(np.trace(K)) or 1.0)
    weighs = M.diagonal() > least * np.maximum(K.diagonal(), 0.0)
    diagonal = np.where(weighs, M.diagonal(), abs(M).max(initial=0.0) or 1.0)
    scale = 1 / np.sqrt(diagonal)
    scaled = _symmetric(M * np.outer(scale, scale))
    weight, U = la.eigh(scaled)
    terms = np.maximum(_parts(scaled, U), 1.0)
    if (weight < -_NEGATIVE * terms).any():
        raise MatrixError(
            f"the mass matrix is not positive semidefinite: a shape has {(weight / terms).min():.2g} times the mass of "
            "its parts; check the signs of its entries off the diagonal"
        )
    massless = weight <= _limit(rounding) * terms
    T, N = scale[:, None] * U[:, ~massless], scale[:, None] * U[:, massless]
    if N.shape[1]:
        N = _orthonormal_in_stiffness(K, N, rounding)
        for _ in range(2):
            T = T - N @ (N.T @ (K @ T))
    return T, weight[~massless], N


def _orthonormal_in_stiffness(K: NDArray[np.float64], N: NDArray[np.float64], rounding: float) -> NDArray[np.float64]:
    """Shapes of the same span with N^T K N = I; a shape whose strain energy is rounding of its terms has none."""
    # The second time from shapes that are orthogonal already, so that a soft one beside a stiff one keeps its digits.
    for _ in range(2):
        energy = np.einsum("ij,ij->j", N, K @ N)
        N = N / np.sqrt(np.where(energy > 0, energy, 1.0))
        N = N @ la.eigh(_symmetric(N.T @ K @ N))[1]
    energy = np.einsum("ij,ij->j", N, K @ N)
    loose = energy <= _limit(rounding) * _parts(K, N)
    if loose.any():
        raise UndeterminedError(
            f"{np.count_nonzero(loose)} motions have neither mass nor stiffness, so that nothing determines them",
            N[:, int(np.argmax(loose))],
        )
    return np.asarray(N / np.sqrt(energy))


def _parts(A: NDArray[np.float64], X: NDArray[np.float64]) -> NDArray[np.float64]:
    """Absolute parts that the energy of each column is the sum of."""
    return np.asarray(np.einsum("ij,ij->j", abs(X), abs(A) @ abs(X)))


def _limit(rounding: float) -> float:
    return max(_LEFT_BY_ARITHMETIC * float(np.finfo(float).eps), _LEFT_BY_FILE * rounding)


def orthonormal(X: NDArray[np.float64], G: NDArray[np.float64]) -> NDArray[np.float64]:
    """Combinations of independent shapes (n, r) that make their Gram matrix (r, r) the identity."""
    if not G.size:
        return X
    return np.asarray(la.solve_triangular(la.cholesky(_symmetric(G)), X.T, trans="T").T)


def _symmetric(A: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((A + A.T) / 2)
