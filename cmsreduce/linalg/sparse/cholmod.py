"""Backend CHOLMOD by scikit-sparse: supernodal Cholesky factors in METIS order, on any platform."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import by_columns
from cmsreduce.linalg.sparse.factor import Admit, Factor, SingularFactorError
from cmsreduce.linalg.sparse.factor_size import factor_cost
from cmsreduce.linalg.sparse.superlu import SuperLU

__all__ = ["Cholmod", "cholmod_factor"]

# Bytes for each entry of L, with the padding of its blocks and the work space: 12 in large factors, 15 in small ones.
_BYTES = 15.0
# scikit-sparse from 0.5 on converts the blocks to a sparse factor, and both are in memory: 18 to 22 bytes.
_BYTES_UNBLOCKED = 23.0


def cholmod_factor(A: sp.csc_array, definite: bool, admit: Admit) -> Factor:
    """Factor of a definite matrix by CHOLMOD, and of any other matrix by SuperLU.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite.
    admit : callable
        Refuses a factor that is too large.

    Returns
    -------
    Factor

    Raises
    ------
    SingularFactorError
        If a pivot is zero, or not positive in a definite matrix.
    """
    # CHOLMOD's L D L^T works entry by entry without pivoting: it takes four times as long as SuperLU for a solid of
    # 30 000 rows, and stops at a zero on the diagonal.
    return Cholmod(A, admit) if definite else SuperLU(A, definite, admit)


class Cholmod(Factor):
    """Cholesky factors L L^T of a positive definite matrix.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric; its lower triangle is read.
    admit : callable
        Refuses a factor that is too large.

    Raises
    ------
    SingularFactorError
        If a pivot is not positive.
    ImportError
        If scikit-sparse is not installed.

    Notes
    -----
    Source: Y. Chen, T. Davis, W. Hager, S. Rajamanickam, "Algorithm 887: CHOLMOD", ACM Trans. Math. Softw. 35 (2008).
    scikit-sparse 0.4 and 0.5 both work; 0.5 renamed every call.
    """

    backend: str = "cholmod"

    def __init__(self, A: sp.csc_array, admit: Admit) -> None:
        from sksparse import cholmod

        renamed = hasattr(cholmod, "CholeskyFactor")
        try:
            if renamed:
                self._factor: Any = cholmod.CholeskyFactor(A, order="metis", supernodal_mode="supernodal")
                order = self._factor.get_perm()
            else:
                self._factor = cholmod.analyze(A, mode="supernodal", ordering_method="metis")
                order = self._factor.P()
            self._order = np.array(order, dtype=np.int64)
            super().__init__(A, factor_cost(A, self._order, _BYTES_UNBLOCKED if renamed else _BYTES))
            admit(self.cost)
            (self._factor.factorize if renamed else self._factor.cholesky_inplace)(A)
        except cholmod.CholmodNotPositiveDefiniteError:
            raise SingularFactorError from None
        self._solve_dense = self._factor.solve if renamed else self._factor.solve_A

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(self._solve_dense(by_columns(b)))

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Squares of the diagonal of L in the matrix's own row order (n,)."""
        D = self._factor.D
        pivots = np.empty(self.n)
        # D of scikit-sparse 0.4 is the squared diagonal of L; D of 0.5, for L L^T, is the identity.
        pivots[self._order] = D() if callable(D) else self._factor.factor.diagonal() ** 2
        return pivots

    @property
    def inertia_known(self) -> bool:
        """True: rows and columns have one order."""
        return True
