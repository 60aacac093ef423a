"""Backend `cmsreduce.multifrontal`, with the settings and errors of this package: symmetric factors on all threads."""

from __future__ import annotations

from functools import cached_property, partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse.factor import Admit, Factor, FactorCost, SingularFactorError, UnstableFactorError
from cmsreduce.linalg.sparse.lower_triangle import nonzero_pattern
from cmsreduce.model import mapped_values
from cmsreduce.multifrontal import nested_dissection

__all__ = ["Multifrontal"]


class Multifrontal(Factor):
    """Cholesky factors L L^T, or L S L^T with signs S of a matrix that need not be definite.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    admit : callable
        Refuses a factor that is too large.
    scale : (n,) float64, optional
        Scale, for a factor of the scaled matrix in float32: half the memory and half the time, seven digits.
    folder : Path, optional
        Folder of a file for the entries; in memory if absent.
    definite : bool
        Whether the matrix is taken to be positive definite.
    solves : bool
        False if only the inertia is asked for: the entries of the factor are not kept.

    Raises
    ------
    SingularFactorError
        If a pivot of a definite matrix is not positive.
    UnstableFactorError
        If an indefinite matrix needs other pivots.
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
        *,
        definite: bool = True,
        solves: bool = True,
    ) -> None:
        # Imported here: numba takes half a second to load, which small bodies do not need.
        from cmsreduce.multifrontal import CholeskyFactor, FactorSize, NotPositiveDefiniteError, UnstableError

        def admit_size(size: FactorSize) -> None:
            file = 0.0 if folder is None else size.stored
            cost = FactorCost(size.entries, size.operations, size.bytes - file, file)
            super(Multifrontal, self).__init__(A, cost)
            admit(self.cost)

        settings, pattern = current_settings(), nonzero_pattern(A)
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
                indefinite=not definite,
                kept=solves,
            )
        except UnstableError:
            raise UnstableFactorError from None
        except NotPositiveDefiniteError as error:
            # An L D L^T, which shows the weakest row, has no room in memory if this factor has none.
            raise SingularFactorError(None if folder is None else error.row) from None

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) for A itself, in the layout of b; in single precision to seven digits."""
        return self._factor.solve(b)

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,); where a block is not definite, its eigenvalues."""
        return self._factor.pivots

    def _negative_pivots(self) -> int:
        return self._factor.negative

    @property
    def inertia_known(self) -> bool:
        """True: rows and columns have one order."""
        return True
