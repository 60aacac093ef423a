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
# A shape's kinetic energy below this many roundings of its own terms is cancellation: the shape has no mass.
_MASSLESS = 20.0


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
    K: NDArray[np.float64], M: NDArray[np.float64], rigid: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """All finite elastic eigenpairs of a dense pencil whose rigid modes are known.

    The pencil is turned over, M x = mu K x, so that soft modes keep their relative accuracy and a singular
    mass matrix gives mu = 0, an eigenvalue at infinity, rather than a large number made of round-off. It is
    solved on the M-orthogonal complement of the rigid modes, so that no shift enters the elastic ones.

    Parameters
    ----------
    K, M : (m, m) float64
        Stiffness, mass: symmetric, positive semidefinite.
    rigid : (m, r) float64
        Modes on which K vanishes, orthonormal in M.

    Returns
    -------
    lam : (p,) float64
        Squared frequencies, ascending, p = m - r - (number of massless coordinates).
    X : (m, p) float64
        Modes, orthonormal in M and M-orthogonal to ``rigid``.

    Raises
    ------
    MatrixError
        If K is singular beyond ``rigid``.
    """
    m = K.shape[0]
    if m == 0:
        return np.empty(0), np.empty((0, 0))
    r = rigid.shape[1]
    # Unit diagonal of M, so that coordinates of unlike units mix without loss of digits.
    weight = np.where(M.diagonal() > 0, M.diagonal(), abs(M).max(initial=0.0) or 1.0)
    scale = 1 / np.sqrt(weight)
    Ks, Ms = K * np.outer(scale, scale), M * np.outer(scale, scale)
    Q, _ = la.qr((M @ rigid) * scale[:, None]) if r else (np.eye(m), None)
    Z = Q[:, r:]
    try:
        mu, Y = la.eigh(_symmetric(Z.T @ Ms @ Z), _symmetric(Z.T @ Ks @ Z))
    except la.LinAlgError:
        raise MatrixError("the stiffness is singular beyond the rigid-body modes: a mechanism is left") from None
    mu, Y = mu[::-1], Y[:, ::-1]
    W = Z @ Y
    terms = np.einsum("ij,ij->j", abs(W), abs(Ms) @ abs(W))
    finite = mu > _MASSLESS * np.finfo(float).eps * terms
    mu, X = mu[finite], scale[:, None] * W[:, finite]
    lam, X = 1 / mu, X / np.sqrt(mu)
    for _ in range(2):
        X -= rigid @ (rigid.T @ (M @ X))
        lam, X = refine(K, M, lam, X)
    order = np.argsort(lam, kind="stable")
    return lam[order], X[:, order]


def _symmetric(A: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((A + A.T) / 2)
