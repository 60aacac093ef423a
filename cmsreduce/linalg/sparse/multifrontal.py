"""Backend `cmsreduce.multifrontal`, with the settings and errors of this package: Cholesky factors on all threads."""

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
        S, for factors of S A S in float32: half the memory and half the time, seven digits.

    Raises
    ------
    SingularFactorError
        If a pivot is not positive.
    """

    backend: str = "multifrontal"

    def __init__(self, A: sp.csc_array, admit: Admit, scale: NDArray[np.float64] | None = None) -> None:
        # Imported here: numba takes half a second to load, which small bodies do not need.
        from cmsreduce.multifrontal import CholeskyFactor, FactorSize, NotPositiveDefiniteError

        def admit_size(size: FactorSize) -> None:
            super(Multifrontal, self).__init__(A, FactorCost(*size))
            admit(self.cost)

        settings, pattern = current_settings(), lower_pattern(A)
        order = settings.orders.find(*pattern)
        if order is None:
            order = nested_dissection(A)
            settings.orders.store(*pattern, order)
        # A factor needs memory for its work: the pattern goes first.
        del pattern
        try:
            self._factor = CholeskyFactor(A, order, threads=settings.thread_count, scale=scale, admit=admit_size)
        except NotPositiveDefiniteError:
            raise SingularFactorError from None

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) for A, not for S A S, in the layout of b; in single precision to seven digits."""
        return self._factor.solve(b)

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,)."""
        return self._factor.pivots

    @property
    def inertia_known(self) -> bool:
        """True: rows and columns have one order."""
        return True
