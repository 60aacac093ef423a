"""Multifrontal factors as a backend: `cmsreduce.multifrontal` with the settings and the errors of this package."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.sparse.lower_triangle import lower_pattern
from cmsreduce.multifrontal import nested_dissection

__all__ = ["Multifrontal"]


class Multifrontal(Factor):
    """Cholesky factors L L^T of a positive definite matrix.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    admit : callable
        Refuses a factor that is too large.
    scale : (n,) float64, optional
        S, for factors of S A S in float32 instead: half the memory and the time, seven digits.

    Raises
    ------
    SingularFactorError
        If a pivot is not positive.
    """

    backend: str = "multifrontal"

    def __init__(self, A: sp.csc_array, admit: Admit, scale: NDArray[np.float64] | None = None) -> None:
        # numba takes half a second to load, which small bodies need not wait for.
        from cmsreduce.multifrontal import CholeskyFactor, FactorSize, NotPositiveDefiniteError

        def admitted(size: FactorSize) -> None:
            super(Multifrontal, self).__init__(A, FactorCost(*size))
            admit(self.cost)

        threads = current_settings().thread_count
        try:
            self._factor = CholeskyFactor(A, _order(A), threads=threads, scale=scale, admit=admitted)
        except NotPositiveDefiniteError:
            raise SingularFactorError from None

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) for A, whatever the matrix was scaled by, laid out as b; in single precision to 7 digits."""
        return self._factor.solve(b)

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,)."""
        return self._factor.pivots

    @property
    def inertia_known(self) -> bool:
        """True: rows and columns are permuted alike."""
        return True


def _order(A: sp.csc_array) -> NDArray[np.int64]:
    """Fill-reducing order, found before or found now."""
    orders, pattern = current_settings().orders, lower_pattern(A)
    known = orders.find(*pattern)
    if known is None:
        known = nested_dissection(A)
        orders.store(*pattern, known)
    return np.asarray(known, dtype=np.int64)
