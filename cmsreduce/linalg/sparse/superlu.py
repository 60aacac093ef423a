"""Backend SuperLU, which comes with scipy: runs everywhere, at a tenth of the speed of a symmetric solver."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.sparse.factor_size import factor_cost
from cmsreduce.multifrontal import dissection_installed, nested_dissection

__all__ = ["SuperLU"]

# From this number of rows on nested dissection saves time; below, SuperLU's minimum degree has about the same fill.
_DISSECTED = 10_000
# Bytes for each entry of L: up to 25 for L, U and the matrix, and 23 for the copies that scipy makes for the pivots.
_BYTES = 48.0


class SuperLU(Factor):
    """LU factors with rows and columns in one order and diagonal pivots.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite.
    admit : callable
        Refuses a factor that is too large. Without METIS the size is a lower bound: SuperLU's own order is unknown.

    Raises
    ------
    SingularFactorError
        If a pivot is exactly zero.

    Notes
    -----
    SuperLU's defaults for panels and relaxed supernodes stay: larger ones gain less than a tenth and overrun its work
    arrays (scipy 1.17).
    """

    backend: str = "superlu"

    def __init__(self, A: sp.csc_array, definite: bool, admit: Admit) -> None:
        self._order, counted = _analysed(A, admit)
        permuted = A if self._order is None else sp.csc_array(A[self._order][:, self._order])
        try:
            self.lu = spla.splu(
                permuted,
                permc_spec="MMD_AT_PLUS_A" if self._order is None else "NATURAL",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True, "Equil": False},
            )
        except RuntimeError:
            raise SingularFactorError from None
        nnz = int(self.lu.nnz) // 2
        super().__init__(A, counted or FactorCost(nnz, 2.0 * nnz**2 / max(A.shape[0], 1), _BYTES * nnz))

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        b = by_columns(b)
        if self._order is None:
            return np.asarray(self.lu.solve(b))
        x = np.empty_like(b)
        x[self._order] = self.lu.solve(b[self._order])
        return x

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,)."""
        eliminated = np.asarray(self.lu.U.diagonal()[self.lu.perm_c])
        if self._order is None:
            return eliminated
        pivots = np.empty(self.n)
        pivots[self._order] = eliminated
        return pivots

    @property
    def inertia_known(self) -> bool:
        """True if rows and columns have one order."""
        return bool(np.array_equal(self.lu.perm_r, self.lu.perm_c))


def _analysed(A: sp.csc_array, admit: Admit) -> tuple[NDArray[np.int64] | None, FactorCost | None]:
    """Order of the elimination and its cost; None for both if SuperLU's own minimum degree is good enough."""
    n = A.shape[0]
    if not dissection_installed():
        admit(FactorCost(A.nnz // 2, 0.0, _BYTES * A.nnz / 2))
        return None, None
    full = n * (n + 1) // 2
    if n < _DISSECTED and _fits(FactorCost(full, n**3 / 3, _BYTES * full), admit):
        return None, None
    order = nested_dissection(A)
    cost = factor_cost(A, order, _BYTES)
    admit(cost)
    return order, cost


def _fits(cost: FactorCost, admit: Admit) -> bool:
    try:
        admit(cost)
    except MatrixError:
        return False
    return True
