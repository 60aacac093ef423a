"""Eigenpairs of small dense symmetric pencils, accurate at both ends of the spectrum."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["elastic_pairs", "refine"]

# A first-order step is trusted where it rotates two modes by less than this; closer modes are one cluster, in which
# any rotation is as good and only orthonormality is restored.
_TRUSTED = 1e-4
# A shape's kinetic energy below this many roundings of its own terms is cancellation: the shape has no mass. The
# first factor is for what arithmetic leaves, the second for what the file leaves: its rounding is relative to the
# decade of a number.
_LEFT_BY_ARITHMETIC = 20.0
_LEFT_BY_FILE = 10.0
# Beyond this share a negative kinetic energy is no cancellation.
_NEGATIVE = 1e-6


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
    R = np.eye(lam.size) - X.T @ M @ X
    S = X.T @ K @ X
    gap = lam[None, :] - lam[:, None]
    step = S + R * lam[None, :]
    near = np.maximum(abs(step), abs(step.T)) >= _TRUSTED * abs(gap)
    E = np.where(near, R / 2, step / np.where(near, 1.0, gap))
    X = X + X @ E
    weight = np.einsum("ij,ij->j", X, M @ X)
    return np.einsum("ij,ij->j", X, K @ X) / weight, X / np.sqrt(weight)


def elastic_pairs(
    K: NDArray[np.float64],
    M: NDArray[np.float64],
    rigid: NDArray[np.float64],
    rounding: float = 2.0**-53,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """All finite elastic eigenpairs of a dense pencil whose rigid modes are known.

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
        Relative rounding of the entries of M, where they are printed with few digits.

    Returns
    -------
    lam : (p,) float64
        Squared frequencies, ascending, p = m - r - (number of massless shapes).
    X : (m, p) float64
        Modes, orthonormal in M and M-orthogonal to ``rigid``.

    Raises
    ------
    MatrixError
        If K is singular beyond ``rigid``, or M gives a shape negative mass.
    """
    if K.shape[0] == 0:
        return np.empty(0), np.empty((0, 0))
    r = rigid.shape[1]
    # Unit diagonal of M, so that coordinates of unlike units mix without loss of digits.
    weight = np.where(M.diagonal() > 0, M.diagonal(), abs(M).max(initial=0.0) or 1.0)
    scale = 1 / np.sqrt(weight)
    Ks, Ms = K * np.outer(scale, scale), M * np.outer(scale, scale)
    try:
        T, weight = _with_mass(Ks, Ms, rounding)
        # In coordinates along T the mass is diagonal, and rigid motion is M-orthogonal to the columns of Z.
        Q, _ = la.qr(T.T @ ((M @ rigid) * scale[:, None])) if r else (np.eye(weight.size), None)
        Z = Q[:, r:]
        mu, Y = la.eigh(_symmetric(Z.T @ (weight[:, None] * Z)), _symmetric(Z.T @ (T.T @ Ks @ T) @ Z))
    except la.LinAlgError:
        raise MatrixError("the stiffness is singular beyond the rigid-body modes: a mechanism is left") from None
    mu, X = mu[::-1], scale[:, None] * (T @ (Z @ Y[:, ::-1]))
    lam, X = 1 / mu, X / np.sqrt(mu)
    for _ in range(2):
        X -= rigid @ (rigid.T @ (M @ X))
        lam, X = refine(K, M, lam, X)
    order = np.argsort(lam, kind="stable")
    return lam[order], X[:, order]


def _with_mass(
    K: NDArray[np.float64], M: NDArray[np.float64], rounding: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Shapes that carry mass, the massless ones following them statically (m, p), and their masses (p,).

    K, M : (m, m) float64, M with a unit diagonal but for massless coordinates.
    """
    weight, U = la.eigh(_symmetric(M))
    terms = np.maximum(np.einsum("ij,ij->j", abs(U), abs(M) @ abs(U)), 1.0)
    limit = max(_LEFT_BY_ARITHMETIC * float(np.finfo(float).eps), _LEFT_BY_FILE * rounding)
    if (weight < -_NEGATIVE * terms).any():
        raise MatrixError(
            f"the mass matrix is not positive semidefinite: a shape has {(weight / terms).min():.2g} times the mass of "
            "its parts; check the signs of its entries off the diagonal"
        )
    massless = weight <= limit * terms
    N, T = U[:, massless], U[:, ~massless]
    if N.shape[1]:
        T = T - N @ la.solve(_symmetric(N.T @ K @ N), N.T @ K @ T, assume_a="pos")
    return T, weight[~massless]


def _symmetric(A: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((A + A.T) / 2)
