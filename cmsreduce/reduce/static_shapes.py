"""Static shapes: responses to loads, without the part that the normal modes of a basis hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import (
    Product,
    column_blocks,
    combined,
    congruence,
    dense,
    new_basis,
    put,
    row_blocks,
    symmetric_product,
)
from cmsreduce.linalg.sparse import (
    BLOCK,
    ElasticFlexibility,
    NotPositiveDefiniteError,
    Solve,
    factorise,
    held_factor,
)
from cmsreduce.model import FEModel

__all__ = ["Loads", "elastic_solve", "few_digits", "independent_columns", "residual_shapes", "unit_loads"]

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

# A load's static shape is new when the shapes before it leave more than this share of its strain energy: round-off
# leaves 1e-14.
_NEW = 1e-12
# Modes are removed from a load before the solve; of a load in their span this leaves the square of their own error.
# A mode far softer than the rest may hold all but 1e-14 of a load's energy, and the remainder matters.
_BEYOND_MODES = 1e-18
# Relative to the largest strain energy under a load of the same norm: less is the square of round-off, as under loads
# that only move parts of a body, such as the ends of a spring across it.
_ROUND_OFF = 1e-28
# A unit shape that has less energy once the known ones are removed again was the rounding of theirs.
_LEFT = 0.5
# Shapes of a basis are dependent when the others leave less than this share of one's strain energy.
_DEPENDENT = 1e-13
# Relative rounding of entries that are printed with twelve digits or fewer.
_FEW_DIGITS = 1e-12
# The root of rounding: from an error of orthonormality this small, a step of Newton's iteration leaves rounding.
_NEARLY_ORTHONORMAL = 1e-8


@dataclass(frozen=True)
class Loads:
    """Loads that are computed a block at a time: those of a wide interface would need as much memory as its shapes.

    Parameters
    ----------
    count : int
        l loads.
    block : callable
        Returns the loads of a slice of their numbers (n, k).
    """

    count: int
    block: Callable[[slice], Array]

    @classmethod
    def of(cls, F: Array | sp.csc_array) -> Loads:
        """Columns of a matrix (n, l), dense or sparse."""
        return cls(int(F.shape[1]), lambda part: dense(F[:, part]))


def residual_shapes(
    solve: Solve, K: sp.csc_array, loads: Array | sp.csc_array | Loads, known: Array, M: sp.csc_array | None = None
) -> tuple[Array, Rows]:
    """Static responses without the part that other shapes hold.

    Parameters
    ----------
    solve : callable
        Flexibility: solves K x = f, for a free body without rigid motion.
    K : (n, n) sparse array
        Stiffness.
    loads : (n, l) float64, sparse array or Loads
        Loads.
    known : (n, k) float64
        Shapes of the basis; none may be rigid.
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
    (G - V V^T) F with V the known shapes orthonormal in K. They are removed from the loads before the solve, so that
    the small remainder keeps all its digits. Source: Craig and Chang (1977); theory section 2.
    """
    F = loads if isinstance(loads, Loads) else Loads.of(loads)
    n = K.shape[0]
    if not F.count:
        return np.zeros((n, 0)), np.empty(0, dtype=np.int64)
    # K V = M V w^2 for modes: through M a mode much softer than the rest is removed without the rounding of K V.
    V, force = (_orthonormal(known, K), symmetric_product(K)) if M is None else (known, symmetric_product(M))
    share = np.ones(V.shape[1])
    if M is not None:
        stiffness = symmetric_product(K)
        for part in column_blocks(V.shape[1]):
            share[part] = 1 / np.einsum("ij,ij->j", V[:, part], stiffness(V[:, part]))
    U, of_known, norm = new_basis(n, F.count), np.empty(F.count), np.empty(F.count)
    for first in range(0, F.count, BLOCK):
        part = slice(first, min(first + BLOCK, F.count))
        f = F.block(part)
        held = V.T @ f
        put(solve(f - force(V @ held)), U[:, part])
        _clear(U[:, part], V, force)
        of_known[part], norm[part] = share @ held**2, np.einsum("ij,ij->j", f, f)
    energy = congruence(K, U)
    own = energy.diagonal()
    total = own + of_known
    floor = _ROUND_OFF * norm * (total / np.where(norm > 0, norm, 1.0)).max()
    beyond = own > np.maximum((_NEW if M is None else _BEYOND_MODES) * total, floor)
    scale = np.where(beyond, 1 / np.sqrt(np.where(beyond, own, 1.0)), 0.0)
    R, number = _pivoted_cholesky(energy * np.outer(scale, scale), _NEW)
    Psi = new_basis(n, number.size)
    for rows in row_blocks(n, F.count):
        Psi[rows] = _over(U[rows][:, number] * scale[number], R)
    del U
    # Shapes of nearly equal loads lose digits when they are made orthonormal: the step is repeated.
    for _ in range(2 if number.size else 0):
        _clear(Psi, V, force)
        energy = congruence(K, Psi)
        left = energy.diagonal() > _LEFT
        if not left.all():
            Psi, number, energy = combined(Psi, np.eye(left.size)[:, left]), number[left], energy[np.ix_(left, left)]
        R = la.cholesky(energy)
        for rows in row_blocks(n, number.size):
            Psi[rows] = _over(Psi[rows], R)
    return Psi, number


def independent_columns(G: Array, share: float) -> Rows:
    """Choose independent columns by Cholesky with pivots.

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


def elastic_solve(body: FEModel, rigid: Array, interface: Rows | None = None) -> Solve:
    """Flexibility of a body as it is: elastic where it is free to move, K^-1 where it is held.

    With the rows of the interface, as of `held_factor`, the factor is the one that proved the stiffness of the body.

    Raises
    ------
    NotPositiveDefiniteError
        If the stiffness leaves other motions free than the rigid ones; with its digits if they are few.
    """
    what = f"body '{body.name}': the stiffness"
    try:
        if rigid.shape[1]:
            return ElasticFlexibility(body.K, body.M, rigid, interface)
        if interface is None:
            return factorise(body.K, what=what, kept=True)
        return held_factor(body.K, rigid, what, interface)[-1]
    except NotPositiveDefiniteError as error:
        if not (digits := few_digits(body)):
            raise
        raise NotPositiveDefiniteError(f"{error}{digits}", error.row) from error


def few_digits(body: FEModel) -> str:
    """Sentence for a refusal that the digits of the stiffness may explain; empty if it has those of a double."""
    if body.stiffness_rounding < _FEW_DIGITS:
        return ""
    return (
        f". The entries of its stiffness are known to {body.stiffness_rounding:.0e} of their size, which soft motions, "
        "as of a thin plate or rod, may need: write the matrices with all digits of a double-precision number, in text "
        "with sixteen"
    )


def unit_loads(n: int, rows: Rows, others: Array | None = None) -> sp.csc_array:
    """Unit forces on some dofs, followed by other loads (n, i + l)."""
    at = (rows, np.arange(rows.size))
    loads = sp.csc_array(sp.coo_array((np.ones(rows.size), at), shape=(n, rows.size)))
    return loads if others is None else sp.csc_array(sp.hstack([loads, sp.csc_array(others)]))


def _clear(shapes: Array, V: Array, force: Product) -> None:
    """Remove from shapes, in place, their projection on others in the norm of a matrix, by its product."""
    for part in column_blocks(shapes.shape[1]):
        shapes[:, part] -= V @ (V.T @ force(shapes[:, part]))


def _pivoted_cholesky(G: Array, share: float) -> tuple[Array, Rows]:
    """Triangular factor (p, p) of the independent columns of a Gram matrix, and their numbers."""
    if G.diagonal().max(initial=0.0) <= share:
        return np.empty((0, 0)), np.empty(0, dtype=np.int64)
    factor, order, rank, _ = la.lapack.dpstrf((G + G.T) / 2, tol=share)
    return np.triu(factor[:rank, :rank]), np.asarray(order[:rank] - 1, dtype=np.int64)


def _over(shapes: Array, R: Array) -> Array:
    """Shapes times the inverse of a triangular matrix."""
    return np.asarray(la.solve_triangular(R, shapes.T, trans="T").T) if R.size else shapes


def _orthonormal(shapes: Array, K: sp.csc_array) -> Array:
    """Basis of the span of some shapes, orthonormal in K."""
    for _ in range(2):
        energy = congruence(K, shapes)
        scale = 1 / np.sqrt(np.maximum(energy.diagonal(), np.finfo(float).tiny))
        G = energy * np.outer(scale, scale)
        if G.shape[0] * abs(G - np.eye(G.shape[0])).max(initial=0.0) <= _NEARLY_ORTHONORMAL:
            # True of modes and residual shapes: one step of Newton's iteration for the inverse root of G is enough.
            return combined(shapes, scale[:, None] * (1.5 * np.eye(G.shape[0]) - 0.5 * G))
        weight, W = la.eigh(G)
        own = weight > _DEPENDENT
        shapes = combined(shapes, scale[:, None] * W[:, own] / np.sqrt(weight[own]))
    return shapes
