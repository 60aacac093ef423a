"""Factorise a sparse symmetric matrix once, solve for blocks of right-hand sides, count negative pivots."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["BLOCK", "Factor", "NotPositiveDefiniteError", "factorise"]

BLOCK = 64
"""Right-hand sides solved at once: wide enough to reuse the factor, narrow enough to stay in memory."""

# A pivot is what its diagonal entry leaves after cancellation. Of a singular matrix of a few dofs up to a hundred
# roundings are left (2e-14 seen), of a large one n of them; a cantilever of a thousand elements in a row leaves 1e-10.
_FEWEST_ROUNDINGS = 1000
_LARGEST_SINGULAR = 1e-10
# A pivot that small may also be a soft spring beside a stiff one. A motion that nothing resists then leaves less than
# one rounding of its energy's absolute parts, a spring that the entries still hold leaves more than this.
_LEFT_BY_ARITHMETIC = 5.0
# Raises a matrix that is exactly singular enough to be factorised, so that its smallest pivot shows where.
_RAISED = 1e-8


class NotPositiveDefiniteError(MatrixError):
    """A matrix that had to be positive definite is not; ``row`` is where the factorisation says so."""

    def __init__(self, message: str, row: int) -> None:
        super().__init__(message)
        self.row = row


@dataclass(frozen=True, eq=False)
class Factor:
    """Triangular factors of a symmetric matrix: call it with a right-hand side to solve.

    Parameters
    ----------
    lu : SuperLU
        The factors.
    diagonal : (n,) float64
        Diagonal of the matrix itself, the scale pivots are judged by.
    """

    lu: spla.SuperLU
    diagonal: NDArray[np.float64]

    def __call__(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve A x = b for one column or a block.

        Parameters
        ----------
        b : (n,) or (n, k) float64

        Returns
        -------
        x : float64, shape of ``b``
        """
        b = np.asarray(b, dtype=np.float64)
        if b.ndim == 1 or b.shape[1] <= BLOCK:
            return np.asarray(self.lu.solve(np.asfortranarray(b)))
        parts = [self.lu.solve(np.asfortranarray(b[:, k : k + BLOCK])) for k in range(0, b.shape[1], BLOCK)]
        return np.hstack(parts)

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order."""
        return np.asarray(self.lu.U.diagonal()[self.lu.perm_c])

    @property
    def symmetric(self) -> bool:
        """Whether rows and columns were permuted alike, so that pivot signs are the inertia (Sylvester)."""
        return bool(np.array_equal(self.lu.perm_r, self.lu.perm_c))

    @property
    def negative_pivots(self) -> int:
        """Number of negative eigenvalues of the matrix.

        Raises
        ------
        MatrixError
            If the factorisation had to pivot off the diagonal, which hides the inertia.
        """
        if not self.symmetric:
            raise MatrixError("the factorisation pivoted off the diagonal: its inertia cannot be read")
        return int(np.count_nonzero(self.lu.U.diagonal() < 0))

    @property
    def pivot_ratio(self) -> NDArray[np.float64]:
        """Pivot over size of the diagonal entry: what is left of a dof's stiffness when those before it are free."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.diagonal != 0, self.pivots / abs(self.diagonal), 0.0)


def factorise(A: sp.csc_array, *, definite: bool = True, what: str = "the matrix") -> Factor:
    """Factorise a sparse symmetric matrix with a symmetric fill-reducing order.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    definite : bool
        Whether the matrix must be positive definite; a shifted one need not.
    what : str
        What the matrix is, for the error message.

    Returns
    -------
    Factor

    Raises
    ------
    NotPositiveDefiniteError
        If ``definite`` and a pivot is not positive, or falls to the round-off of its diagonal entry in a motion whose
        energy is round-off too.
    """
    A = sp.csc_array(A)
    diagonal = A.diagonal()
    try:
        lu = spla.splu(
            A, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True, "Equil": False}
        )
    except RuntimeError:
        row = _singular_row(A)
        raise NotPositiveDefiniteError(f"{what} is singular: nothing holds row {row + 1}", row) from None
    factor = Factor(lu, diagonal)
    if definite:
        limit = min(max(A.shape[0], _FEWEST_ROUNDINGS) * np.finfo(float).eps, _LARGEST_SINGULAR)
        ratio = factor.pivot_ratio
        row = int(np.argmin(ratio)) if ratio.size else 0
        if not factor.symmetric or (ratio.min(initial=1.0) <= limit and not _resists(A, factor, row)):
            raise NotPositiveDefiniteError(
                f"{what} is not positive definite: pivot ratio {ratio.min():.1e} at row {row + 1}", row
            )
    return factor


def _resists(A: sp.csc_array, factor: Factor, row: int) -> bool:
    """Whether a matrix of positive pivots resists its weakest motion, that of the row with the smallest pivot."""
    if factor.pivots.min() <= 0:
        return False
    x = factor(np.eye(1, A.shape[0], row)[0])
    x = factor(factor.diagonal * x / abs(x).max())
    parts = abs(x) @ (abs(A) @ abs(x))
    return bool(x @ (A @ x) > _LEFT_BY_ARITHMETIC * 2.0**-53 * parts)


def _singular_row(A: sp.csc_array) -> int:
    """Row with the smallest pivot, relative to its diagonal, of a matrix whose factorisation met a zero pivot."""
    diagonal = abs(A.diagonal())
    if not diagonal.all():
        return int(np.argmin(diagonal))
    raised = factorise(sp.csc_array(A + _RAISED * sp.diags_array(diagonal)), definite=False)
    return int(np.argmin(abs(raised.pivot_ratio)))
