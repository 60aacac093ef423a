"""What every sparse direct solver gives: a factor to solve with, its pivots, its inertia and what it cost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns

__all__ = ["BLOCK", "Admit", "Factor", "FactorCost", "SingularFactorError"]

BLOCK = 64
"""Right-hand sides solved at once: wide enough to reuse the factor, narrow enough to stay in memory."""


@dataclass(frozen=True)
class FactorCost:
    """What a factorisation will take, known from the pattern of the matrix alone.

    Parameters
    ----------
    nnz : int
        Entries of one triangular factor.
    flops : float
        Floating-point operations of the factorisation.
    bytes : float
        Memory that the factorisation takes at its peak, beside the matrix.
    """

    nnz: int
    flops: float
    bytes: float


Admit = Callable[[FactorCost], None]
"""Called between the symbolic and the numeric phase; raises where the factor would not fit in memory."""


class SingularFactorError(ArithmeticError):
    """A pivot is zero, or negative where it must not be: the factorisation stopped."""


class Factor(ABC):
    """Triangular factors of a sparse symmetric matrix: call it with a right-hand side to solve.

    Parameters
    ----------
    A : (n, n) csc array
        The matrix; its diagonal is the scale that pivots are judged by.
    cost : FactorCost
        Size of the factors.
    """

    backend: str

    def __init__(self, A: sp.csc_array, cost: FactorCost) -> None:
        self.n = int(A.shape[0])
        self.diagonal: NDArray[np.float64] = A.diagonal()
        self.cost = cost

    def __call__(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve A x = b for one column or a block, `BLOCK` columns at a time.

        Parameters
        ----------
        b : (n,) or (n, k) float64

        Returns
        -------
        x : float64, shape of ``b``
            By columns, or by rows where ``b`` lies so.
        """
        b = np.asarray(b, dtype=np.float64)
        if not b.size:
            return np.zeros(b.shape)
        if b.ndim == 1:
            return self._solve(b[:, None])[:, 0]
        if b.shape[1] <= BLOCK:
            return self._solve(b)
        x = np.empty(b.shape, order="F")
        for start in range(0, b.shape[1], BLOCK):
            part = slice(start, start + BLOCK)
            x[:, part] = self._solve(by_columns(b[:, part]))
        return x

    @abstractmethod
    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve for a block (n, k) of any layout; the solution lies by columns, or as the block does."""

    @cached_property
    @abstractmethod
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,); of a block of two rows, its diagonal."""

    @property
    @abstractmethod
    def inertia_known(self) -> bool:
        """Whether the signs of the pivots are the inertia: rows and columns permuted alike, no pivot moved."""

    @property
    def negative_pivots(self) -> int:
        """Number of negative eigenvalues of the matrix (Sylvester).

        Raises
        ------
        MatrixError
            If the factorisation had to pivot off the diagonal, which hides the inertia.
        """
        if not self.inertia_known:
            raise MatrixError("the factorisation pivoted off the diagonal: its inertia cannot be read")
        return self._negative_pivots()

    def _negative_pivots(self) -> int:
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def pivot_ratio(self) -> NDArray[np.float64]:
        """Pivot over size of the diagonal entry: what is left of a dof's stiffness when those before it are free."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.diagonal != 0, self.pivots / abs(self.diagonal), 0.0)

    @property
    def weakest(self) -> tuple[int, float]:
        """Row of the smallest pivot ratio, and that ratio; 0 and 1 for a matrix without rows."""
        ratio = self.pivot_ratio
        row = int(np.argmin(ratio)) if ratio.size else 0
        return row, float(ratio[row]) if ratio.size else 1.0
