"""Interface of all sparse direct solvers: a factor to solve with, its pivots, its inertia and its cost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from threading import Lock

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns

__all__ = ["BLOCK", "Admit", "Factor", "FactorCost", "SingularFactorError", "UnstableFactorError"]

BLOCK = 64
"""Right-hand sides of one solve: enough to reuse the factor, few enough for the memory."""


@dataclass(frozen=True)
class FactorCost:
    """Cost of a factorisation, known from the pattern of the matrix alone.

    Parameters
    ----------
    nnz : int
        Entries of one triangular factor.
    flops : float
        Floating-point operations of the factorisation.
    bytes : float
        Peak memory of the factorisation, without the matrix.
    file : float
        Size of the file that holds the factor, in bytes; 0 for a factor in memory.
    """

    nnz: int
    flops: float
    bytes: float
    file: float = 0.0


Admit = Callable[[FactorCost], None]
"""Called between the symbolic and the numeric phase; raises an error if the factor would not fit in memory."""


class SingularFactorError(ArithmeticError):
    """The factorisation stopped at a zero pivot, or at a negative pivot of a definite matrix.

    ``row`` is that of the pivot, if the matrix cannot be factorised again to find a better one.
    """

    def __init__(self, row: int | None = None) -> None:
        super().__init__()
        self.row = row


class UnstableFactorError(ArithmeticError):
    """An indefinite matrix would lose digits with the pivots of this solver; another solver may have better ones."""


class Factor(ABC):
    """Triangular factors of a sparse symmetric matrix; a call solves for right-hand sides.

    Parameters
    ----------
    A : (n, n) csc array
        The matrix; pivots are compared with its diagonal.
    cost : FactorCost
        Size of the factors.
    """

    backend: str

    def __init__(self, A: sp.csc_array, cost: FactorCost) -> None:
        self.n = int(A.shape[0])
        self.diagonal: NDArray[np.float64] = A.diagonal()
        self.cost = cost
        # Bodies that are reduced at once may share the factor of like matrices; most solvers write into their factor.
        self._in_use = Lock()

    def __call__(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve A x = b for one column or a block, `BLOCK` columns at a time.

        Parameters
        ----------
        b : (n,) or (n, k) float64

        Returns
        -------
        x : float64, shape of ``b``
            Stored by columns, or by rows if ``b`` is.
        """
        b = np.asarray(b, dtype=np.float64)
        if not b.size:
            return np.zeros(b.shape)
        if b.ndim == 1:
            return self._alone(b[:, None])[:, 0]
        if b.shape[1] <= BLOCK:
            return self._alone(b)
        x = np.empty(b.shape, order="F")
        for start in range(0, b.shape[1], BLOCK):
            part = slice(start, start + BLOCK)
            x[:, part] = self._alone(by_columns(b[:, part]))
        return x

    def _alone(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        with self._in_use:
            return self._solve(b)

    @abstractmethod
    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve for a block (n, k) of any layout; the solution is stored by columns, or as the block is."""

    @cached_property
    @abstractmethod
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,); the diagonal of a pivot of two rows."""

    @property
    @abstractmethod
    def inertia_known(self) -> bool:
        """True if the signs of the pivots are the inertia: rows and columns have one order, and no pivot was moved."""

    @property
    def negative_pivots(self) -> int:
        """Number of negative eigenvalues of the matrix (Sylvester).

        Raises
        ------
        MatrixError
            If the factorisation had to pivot off the diagonal, which hides the inertia.
        """
        if not self.inertia_known:
            raise MatrixError("the factorisation pivoted off the diagonal: its inertia is unknown")
        return self._negative_pivots()

    def _negative_pivots(self) -> int:
        return int(np.count_nonzero(self.pivots < 0))

    @property
    def weakest(self) -> tuple[int, float]:
        """Row with the smallest ratio of its pivot to its diagonal entry, and this ratio; (0, 1) without rows.

        The ratio is the share of a dof's stiffness that remains when the dofs eliminated before it are free.
        """
        if not self.n:
            return 0, 1.0
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(self.diagonal != 0, self.pivots / abs(self.diagonal), 0.0)
        row = int(np.argmin(ratio))
        return row, float(ratio[row])
