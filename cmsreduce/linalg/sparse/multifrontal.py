"""Backend `cmsreduce.multifrontal`, with the settings and errors of this package: Cholesky factors on all threads."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.sparse.lower_triangle import lower_pattern
from cmsreduce.model import mapped_values
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

    folder : Path, optional
        Folder of a file for the entries; in memory if absent.

    Raises
    ------
    SingularFactorError
        If a pivot is not positive.
    OSError
        If the disk has no room for the file.
    """

    backend: str = "multifrontal"

    def __init__(
        self,
        A: sp.csc_array,
        admit: Admit,
        scale: NDArray[np.float64] | None = None,
        folder: Path | None = None,
    ) -> None:
        # Imported here: numba takes half a second to load, which small bodies do not need.
        from cmsreduce.multifrontal import CholeskyFactor, FactorSize, NotPositiveDefiniteError

        def admit_size(size: FactorSize) -> None:
            file = 0.0 if folder is None else size.stored
            cost = FactorCost(size.entries, size.operations, size.bytes - file, file)
            super(Multifrontal, self).__init__(A, cost)
            admit(self.cost)

        settings, pattern = current_settings(), lower_pattern(A)
        order = settings.orders.find(*pattern)
        if order is None:
            order = nested_dissection(A)
            settings.orders.store(*pattern, order)
        # A factor needs memory for its work: the pattern goes first.
        del pattern
        try:
            self._factor = CholeskyFactor(
                A,
                order,
                threads=settings.thread_count,
                scale=scale,
                admit=admit_size,
                allocate=np.empty if folder is None else partial(mapped_values, folder),
            )
        except NotPositiveDefiniteError as error:
            # An L D L^T, which shows the weakest row, has no room in memory if this factor has none.
            raise SingularFactorError(None if folder is None else error.row) from None

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
