"""Static shapes: the response to loads that the normal modes of a basis do not hold."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.factorise import factorise
from cmsreduce.linalg.flexibility import ElasticFlexibility, Solve
from cmsreduce.linalg.pencil import orthonormal
from cmsreduce.model import FEModel

__all__ = ["elastic_solve", "independent_columns", "residual_shapes", "unit_loads"]

# A load's static shape is new when the shapes before it leave this share of its strain energy: round-off leaves 1e-14.
_NEW = 1e-12
# Where modes are taken out of a load before the solve, what is left of a load within their span is the square of
# their own error. One far softer than the rest may hold all but 1e-14 of a load's energy, and that matters.
_BEYOND_MODES = 1e-18
# Shapes of a basis are dependent when the others leave this share of one's strain energy.
_DEPENDENT = 1e-13


def residual_shapes(
    solve: Solve,
    K: sp.csc_array,
    loads: NDArray[np.float64],
    known: NDArray[np.float64],
    M: sp.csc_array | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Static responses without what other shapes hold of them.

    Parameters
    ----------
    solve : callable
        Flexibility: solves K x = f, for a free body without rigid motion.
    K : (n, n) sparse array
        Stiffness.
    loads : (n, l) float64
        Loads.
    known : (n, k) float64
        Shapes of the basis; none of them rigid.
    M : (n, n) sparse array, optional
        Mass, where ``known`` are its modes with K, orthonormal in M.

    Returns
    -------
    Psi : (n, p) float64
        Residual shapes, orthonormal in K and orthogonal in K to ``known``. With ``known`` they reproduce the static
        response to every load; p <= l, since loads may repeat one another.
    number : (p,) int64
        Load that each shape belongs to.

    Notes
    -----
    (G - V V^T) F with V the known shapes orthonormal in K. They are taken out of the loads before the solve: what
    remains is small, and its digits are its own. Source: Craig and Chang (1977); theory section 2.
    """
    # K V = M V w^2 for modes: through M a mode much softer than the rest is taken out without the rounding of K V.
    V, force = (_orthonormal(known, K), K) if M is None else (known, M)
    share = np.ones(V.shape[1]) if M is None else 1 / np.einsum("ij,ij->j", V, K @ V)
    held = V.T @ loads
    U = solve(loads - force @ (V @ held)) if loads.shape[1] else np.zeros(loads.shape)
    U = U - V @ (V.T @ (force @ U))
    energy = U.T @ (K @ U)
    own = energy.diagonal()
    beyond = own > (_NEW if M is None else _BEYOND_MODES) * (own + share @ held**2)
    scale = np.where(beyond, 1 / np.sqrt(np.where(beyond, own, 1.0)), 0.0)
    R, number = _pivoted_cholesky(energy * np.outer(scale, scale), _NEW)
    Psi = _over(U[:, number] * scale[number], R)
    # Loads nearly alike lose digits when their shapes are made orthonormal, so it is done again.
    for _ in range(2 if number.size else 0):
        Psi = Psi - V @ (V.T @ (force @ Psi))
        Psi = orthonormal(Psi, Psi.T @ (K @ Psi))
    return Psi, number


def independent_columns(G: NDArray[np.float64], share: float) -> NDArray[np.int64]:
    """Choose columns that depend on no others, by Cholesky with pivots.

    Parameters
    ----------
    G : (l, l) float64
        Gram matrix, with a diagonal of one or less.
    share : float
        A column is dropped when the chosen ones leave less than this of its squared norm.

    Returns
    -------
    (p,) int64
        Columns, the largest first.
    """
    return _pivoted_cholesky(G, share)[1]


def elastic_solve(body: FEModel, rigid: NDArray[np.float64]) -> Solve:
    """Flexibility of a body as it is: elastic where it is free to move, K^-1 where it is held."""
    if rigid.shape[1]:
        return ElasticFlexibility(body.K, body.M, rigid)
    return factorise(body.K, what=f"body '{body.name}': the stiffness")


def unit_loads(n: int, rows: NDArray[np.int64], others: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """Unit forces on some dofs, followed by other loads (n, i + l)."""
    loads = np.zeros((n, rows.size))
    loads[rows, np.arange(rows.size)] = 1.0
    return loads if others is None else np.hstack([loads, others])


def _pivoted_cholesky(G: NDArray[np.float64], share: float) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Triangular factor (p, p) of the columns of a Gram matrix that are independent, and which these are."""
    if G.diagonal().max(initial=0.0) <= share:
        return np.empty((0, 0)), np.empty(0, dtype=np.int64)
    factor, order, rank, _ = la.lapack.dpstrf(_symmetric(G), tol=share)
    return np.triu(factor[:rank, :rank]), np.asarray(order[:rank] - 1, dtype=np.int64)


def _over(shapes: NDArray[np.float64], R: NDArray[np.float64]) -> NDArray[np.float64]:
    """Shapes times the inverse of a triangular matrix."""
    return np.asarray(la.solve_triangular(R, shapes.T, trans="T").T) if R.size else shapes


def _orthonormal(shapes: NDArray[np.float64], K: sp.csc_array) -> NDArray[np.float64]:
    """Basis of the span of some shapes, orthonormal in K."""
    for _ in range(2):
        energy = _symmetric(shapes.T @ (K @ shapes))
        scale = 1 / np.sqrt(np.maximum(energy.diagonal(), np.finfo(float).tiny))
        weight, W = la.eigh(energy * np.outer(scale, scale)) if scale.size else (np.empty(0), np.empty((0, 0)))
        own = weight > _DEPENDENT
        shapes = (shapes * scale) @ (W[:, own] / np.sqrt(weight[own]))
    return shapes


def _symmetric(A: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((A + A.T) / 2)
