"""Eigenpairs of small dense symmetric pencils, accurate at both ends of the spectrum."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import absolute_product
from cmsreduce.model import ARITHMETIC, CONDENSATION, Matrix

__all__ = [
    "UNRESISTED",
    "UndeterminedError",
    "elastic_and_massless",
    "elastic_pairs",
    "energy_parts",
    "orthonormal",
    "refine",
    "split_massless",
    "strain_pairs",
]

Array = NDArray[np.float64]

UNRESISTED = 1e-12
"""A motion is not resisted when its strain energy is below this share of the absolute parts of the energy: condensation
leaves 1e-15."""
# A first-order step is used where it rotates two modes by less than this. Closer modes form a cluster, which is solved
# as a small pencil of its own.
_TRUSTED = 1e-4
# A shape has no mass (or no stiffness) if its energy is below this many roundings of the terms of the energy. The first
# factor is for the rounding of arithmetic, the second for the rounding of the file, which is relative to the decade of
# a number.
_LEFT_BY_ARITHMETIC = 20.0
_LEFT_BY_FILE = 10.0
# A negative kinetic energy larger than this share of its terms, and than the rounding of the file, is an error of the
# matrix.
_NEGATIVE = 1e-6
# A mass is real above this many times the largest negative one, which rounding has left, as far as condensation does.
_ABOVE_NEGATIVE = 10.0


class UndeterminedError(MatrixError):
    """A motion has neither mass nor stiffness, so that no equation determines it; ``shape`` (m,) is such a motion."""

    def __init__(self, message: str, shape: Array) -> None:
        super().__init__(message)
        self.shape = shape


def refine(K: Array, M: Array, lam: Array, X: Array) -> tuple[Array, Array]:
    """Improve approximate eigenpairs by one Newton step, which squares their error.

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

    Raises
    ------
    MatrixError
        If some vectors of nearly one eigenvalue are dependent, or have no mass.

    Notes
    -----
    Source: Ogita and Aishima, Japan J. Indust. Appl. Math. 35 (2018), 1007-1035, with M as inner product.
    """
    # S is symmetric to the last digit; otherwise the small gap of a close pair turns rounding into a shear.
    R = np.eye(lam.size) - _symmetric(X.T @ M @ X)
    S = _symmetric(X.T @ K @ X)
    gap = lam[None, :] - lam[:, None]
    step = S + R * lam[None, :]
    near = np.maximum(abs(step), abs(step.T)) >= _TRUSTED * abs(gap)
    E = np.where(near, R / 2, step / np.where(near, 1.0, gap))
    X = X + X @ E
    np.fill_diagonal(near, False)
    for own in _clusters(near):
        x = X[:, own]
        try:
            X[:, own] = x @ la.eigh(_symmetric(x.T @ K @ x), _symmetric(x.T @ M @ x))[1]
        except la.LinAlgError:
            raise MatrixError(
                f"{own.size} modes near the squared frequency {lam[own[0]]:.6g} cannot be told apart: a combination of "
                "them has no mass. The matrices are too ill conditioned, or the mass is not positive definite"
            ) from None
    weight = np.einsum("ij,ij->j", X, M @ X)
    if not (weight > 0).all():
        raise MatrixError(
            "a mode has no mass: the mass is not positive definite, or the matrices are too ill conditioned"
        )
    return np.einsum("ij,ij->j", X, K @ X) / weight, X / np.sqrt(weight)


def _clusters(near: NDArray[np.bool_]) -> Iterator[NDArray[np.int64]]:
    """Numbers of the modes of each cluster, from pairs that are near each other (p, p)."""
    # To look for clusters takes longer than all else in a small pencil, and most have none.
    if near.any():
        clusters, label = csgraph.connected_components(near, directed=False)
        for number in np.flatnonzero(np.bincount(label, minlength=clusters) > 1):
            yield np.flatnonzero(label == number)


def elastic_pairs(K: Array, M: Array, rigid: Array, rounding: float = 2.0**-53) -> tuple[Array, Array]:
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


def elastic_and_massless(K: Array, M: Array, rigid: Array, rounding: float = 2.0**-53) -> tuple[Array, Array, Array]:
    """All elastic modes of a dense pencil with known rigid modes: modes of finite frequency and massless shapes.

    Shapes without mass are condensed statically first, since rounding would make large eigenvalues of them. The
    inverse problem M x = mu K x keeps the relative accuracy of soft modes. It is solved on the M-orthogonal complement
    of the rigid modes, so that the elastic modes need no shift.

    Parameters
    ----------
    K, M : (m, m) float64
        Stiffness, mass: symmetric, positive semidefinite.
    rigid : (m, r) float64
        Modes on which K vanishes, orthonormal in M.
    rounding : float
        Relative rounding of the entries of K and M, for a file of few digits.

    Returns
    -------
    lam : (p,) float64
        Squared frequencies, ascending, p = m - r - s.
    X : (m, p) float64
        Modes, orthonormal in M and M-orthogonal to ``rigid``.
    N : (m, s) float64
        Massless shapes, orthonormal in K and orthogonal in K and M to all others; they follow a load statically.

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
    # The mass is diagonal in the coordinates of T. The columns of Z are M-orthogonal to rigid motion.
    Q, _ = la.qr(T.T @ (M @ rigid)) if r else (np.eye(weight.size), None)
    Z = Q[:, r:]
    try:
        mu, Y = la.eigh(_symmetric(Z.T @ (weight[:, None] * Z)), _symmetric(Z.T @ (T.T @ K @ T) @ Z))
    except la.LinAlgError:
        raise MatrixError(_not_resisted(K, T @ Z, rounding)) from None
    mu, ZY = mu[::-1], Z @ Y[:, ::-1]
    # An eigenvalue below the rounding of the largest may have either sign; a sum of positive terms is positive.
    lost = mu <= np.finfo(float).eps * mu.max(initial=0.0)
    mu = np.where(lost, np.einsum("ij,i,ij->j", ZY, weight, ZY), mu)
    lam, X = 1 / mu, T @ ZY / np.sqrt(mu)
    for _ in range(2):
        X -= rigid @ (rigid.T @ (M @ X))
        lam, X = refine(K, M, lam, X)
    order = np.argsort(lam, kind="stable")
    return lam[order], X[:, order], N


def _not_resisted(K: Array, X: Array, rounding: float) -> str:
    """Reason why K is not positive definite on shapes (m, p): a free motion, lost digits or a wrong sign."""
    energy = _symmetric(X.T @ K @ X)
    size = np.sqrt(np.where(energy.diagonal() != 0, abs(energy.diagonal()), 1.0))
    softest = X @ (la.eigh(energy / np.outer(size, size))[1][:, 0] / size)
    share = float(softest @ K @ softest) / (float(energy_parts(K, softest[:, None])[0]) or 1.0)
    if share < -_limit(rounding):
        return (
            f"the stiffness is not positive semidefinite: a motion has {share:.1e} times the strain energy of its parts"
        )
    return (
        "the stiffness resists a motion beyond the rigid-body modes less than the rounding of its entries "
        f"({rounding:.1e}) shows: the body has a mechanism, or a spring too soft to be told from rounding beside its "
        "stiff parts. Write the matrices with more digits, or make the spring a joint of the scene"
    )


def split_massless(K: Array, M: Array, rounding: float = 2.0**-53) -> tuple[Array, Array, Array]:
    """Split the coordinates of a pencil into shapes with mass and shapes without.

    A shape is massless if its kinetic energy is only rounding of its terms, or less than ten times the rounding that a
    negative one shows; a coordinate also if it is stiffer, for its mass, than a double holds beside the others. Any
    other light mass is a mass.

    Parameters
    ----------
    K, M : (m, m) float64
        Stiffness, mass: symmetric, positive semidefinite.
    rounding : float
        Relative rounding of their entries.

    Returns
    -------
    T : (m, p) float64
        Shapes with mass, orthogonal in M. The massless shapes follow them statically: T^T K N = 0.
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
    # A unit diagonal of M mixes coordinates of different units without loss of digits. A diagonal mass counts as none
    # if a double cannot hold the square of its frequency beside the others, or if negative ones show it as rounding.
    own, stiff = M.diagonal(), np.maximum(K.diagonal(), 0.0)
    negative = np.divide(-own, stiff, out=np.zeros_like(own), where=(own < 0) & (stiff > 0)).max(initial=0.0)
    of_all = float(np.trace(M)) / (float(np.trace(K)) or 1.0)
    weighs = own > max(ARITHMETIC * of_all, min(_ABOVE_NEGATIVE * float(negative), CONDENSATION * of_all)) * stiff
    diagonal = np.where(weighs, M.diagonal(), abs(M).max(initial=0.0) or 1.0)
    scale = 1 / np.sqrt(diagonal)
    scaled = _symmetric(M * np.outer(scale, scale))
    _, U = la.eigh(scaled)
    # The energy of a vector, second order in its error, has fewer roundings than the eigenvalue of a large matrix.
    weight = np.einsum("ij,ij->j", U, scaled @ U)
    terms = np.maximum(energy_parts(scaled, U), 1.0)
    if (weight < -max(_NEGATIVE, _limit(rounding)) * terms).any():
        raise MatrixError(
            f"the mass matrix is not positive semidefinite: a shape has {(weight / terms).min():.2g} times the mass of "
            "its parts; check the signs of the entries off the diagonal"
        )
    # No kinetic energy is negative: the lowest one shows the rounding of the entries, which may be sums of larger ones.
    shown = -float((weight / terms).min(initial=0.0))
    massless = weight <= max(_limit(rounding), min(_ABOVE_NEGATIVE * shown, CONDENSATION)) * terms
    T, N = scale[:, None] * U[:, ~massless], scale[:, None] * U[:, massless]
    if N.shape[1]:
        N = _orthonormal_in_stiffness(K, N, rounding)
        for _ in range(2):
            T = T - N @ (N.T @ (K @ T))
    return T, weight[~massless], N


def _orthonormal_in_stiffness(K: Array, N: Array, rounding: float) -> Array:
    """Shapes of the same span with N^T K N = I; refuses a shape whose strain energy is only rounding of its terms."""
    # The second pass starts from orthogonal shapes, so that a soft one beside a stiff one keeps its digits.
    for _ in range(2):
        energy = np.einsum("ij,ij->j", N, K @ N)
        N = N / np.sqrt(np.where(energy > 0, energy, 1.0))
        N = N @ la.eigh(_symmetric(N.T @ K @ N))[1]
    energy = np.einsum("ij,ij->j", N, K @ N)
    loose = energy <= _limit(rounding) * energy_parts(K, N)
    if loose.any():
        raise UndeterminedError(
            f"{np.count_nonzero(loose)} motions have neither mass nor stiffness, so that nothing determines them",
            N[:, int(np.argmax(loose))],
        )
    return np.asarray(N / np.sqrt(energy))


def energy_parts(A: Matrix, X: Array) -> Array:
    """Sum of the absolute terms of the energy x^T A x of each column (k,)."""
    sizes, X = absolute_product(A) if sp.issparse(A) else abs(A).__matmul__, abs(X)
    return np.asarray(np.einsum("ij,ij->j", X, sizes(X)))


def strain_pairs(K: Array, parts: Array) -> tuple[Array, Array]:
    """Motions that a stiffness resists and motions that it does not.

    Parameters
    ----------
    K : (k, k) float64
        Strain energy of k motions and of their sums.
    parts : (k,) float64
        Sum of the absolute parts of the strain energy of each motion, before they cancel: rounding is a share of these,
        and K alone may hold nothing else.

    Returns
    -------
    strain : (k,) float64
        Strain energy of each combination, relative to the parts; zero where it is rounding.
    X : (k, k) float64
        The combinations as columns; each has parts of about one.
    """
    size = np.sqrt(np.where(parts > 0, parts, 1.0))
    strain, V = la.eigh(K / np.outer(size, size)) if size.size else (size, K)
    return np.where(strain > UNRESISTED, strain, 0.0), V / size[:, None]


def _limit(rounding: float) -> float:
    return max(_LEFT_BY_ARITHMETIC * float(np.finfo(float).eps), _LEFT_BY_FILE * rounding)


def orthonormal(X: Array, G: Array) -> Array:
    """Combine independent shapes (n, r) with Gram matrix G (r, r) so that their Gram matrix is the identity."""
    if not G.size:
        return X
    return np.asarray(la.solve_triangular(la.cholesky(_symmetric(G)), X.T, trans="T").T)


def _symmetric(A: Array) -> Array:
    return np.asarray((A + A.T) / 2)
