"""Factors in single precision with solutions refined to double precision: half the memory, the same digits."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import symmetric_product
from cmsreduce.linalg.sparse.factor import Admit, Factor

__all__ = ["RefinedFactor", "UnrefinableError", "powers_of_two"]

# If a step of refinement leaves at most this share of the error, it converges and the inertia is that of the matrix.
_CONTRACTS = 0.5
# Steps, random columns and seed of the power iteration that measures this share.
_POWER_STEPS, _COLUMNS, _SEED = 4, 4, 11
# Refinement ends at this error, relative to the solution in the norm of the diagonal, or at the error of a factor in
# double precision: the error in single precision times the ratio of the two roundings.
_REFINED = 1e-13
_ROUNDING_RATIO = float(np.finfo(np.float64).eps / np.finfo(np.float32).eps)
_STEPS = 60
# If a correction exceeds this share of the one before, only round-off is left.
_STALLED = 0.8

Rough = Callable[[sp.csc_array, bool, Admit, NDArray[np.float64]], Factor]
"""Makes a factor in single precision. Arguments: the matrix, whether it should be definite, a check of the size, S."""


class UnrefinableError(ArithmeticError):
    """The matrix is too ill conditioned for single precision: refinement would not converge."""


class RefinedFactor(Factor):
    """Single-precision factors, iteratively refined.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    definite : bool
        Whether the matrix is taken to be positive definite.
    admit : callable
        Refuses a factor that is too large.
    rough : callable
        Makes the factor in single precision.

    Raises
    ------
    UnrefinableError
        If a step of refinement leaves more than half of the error.
    SingularFactorError
        If a pivot is zero, or not positive in a definite matrix.

    Notes
    -----
    With A~ = L D L^T computed in single precision, a step of refinement multiplies the error by E = I - A~^-1 A. While
    the spectral radius of E is below one, no matrix between A~ and A is singular (it would make 1/t an eigenvalue of E
    for some t in (0, 1)), so both have the same inertia: the count of negative pivots is exact in spite of few
    digits. A block power iteration measures the radius. Refinement: Higham, Accuracy and Stability of Numerical
    Algorithms, section 12.
    """

    def __init__(self, A: sp.csc_array, definite: bool, admit: Admit, rough: Rough) -> None:
        self._scale = powers_of_two(A.diagonal())
        self._rough = rough(A, definite, admit, self._scale)
        self.backend = self._rough.backend
        super().__init__(A, self._rough.cost)
        self._product = symmetric_product(A)
        self._modes: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]] | None = None
        self.contraction = self._measured_contraction()
        if not self.contraction <= _CONTRACTS:
            raise UnrefinableError

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,), to seven digits; the diagonal of a pivot of two rows."""
        return self._rough.pivots

    @property
    def inertia_known(self) -> bool:
        """True if no pivot had to be moved away from zero."""
        return self._rough.inertia_known

    def _negative_pivots(self) -> int:
        return self._rough.negative_pivots

    def beside(self, lam: NDArray[np.float64], X: NDArray[np.float64], MX: NDArray[np.float64]) -> RefinedFactor:
        """The same factor with known modes of the matrix: single precision loses most digits along soft modes.

        Parameters
        ----------
        lam : (k,) float64
            Eigenvalues of (A, M).
        X, MX : (n, k) float64
            Modes, orthonormal in M, and their product with it.

        Returns
        -------
        RefinedFactor
            It takes two solves instead of four to eight.
        """
        known = copy(self)
        known._modes = (lam, X, MX)
        return known

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        x, last, enough = self.rough(b), np.inf, max(_REFINED, _ROUNDING_RATIO * self.contraction)
        for _ in range(_STEPS):
            rest = b - self._product(x)
            if self._modes is not None:
                lam, X, MX = self._modes
                along = X.T @ rest
                x += X @ (along / lam[:, None])
                rest -= MX @ along
            correction = self.rough(rest)
            if self._modes is not None:
                # A load orthogonal to the modes causes a motion orthogonal to them in M.
                correction -= X @ (MX.T @ correction)
            x += correction
            size, of_x = self._size(correction), self._size(x)
            share = float((size / np.where(of_x > 0, of_x, 1.0)).max())
            # The next correction would shrink as this one did; with known modes, as the first one did relative to x.
            next_share = max(share / last, self.contraction if self._modes is None else share)
            if share * next_share <= enough or share > _STALLED * last:
                break
            last = share
        return x

    def rough(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) to single precision."""
        return self._rough(b)

    def _size(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Norm of each column, with each dof weighted by the root of its stiffness."""
        return np.asarray(np.linalg.norm(x / self._scale[:, None], axis=0))

    def _measured_contraction(self) -> float:
        """Share of an error that is left after a step of refinement."""
        e = np.random.default_rng(_SEED).standard_normal((self.n, _COLUMNS)) * self._scale[:, None]
        share = 0.0
        for _ in range(_POWER_STEPS):
            e /= self._size(e)
            e = e - self.rough(self._product(e))
            share = float(self._size(e).max())
            if not 0 < share < np.inf:
                break
        return share


def powers_of_two(diagonal: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 / sqrt(|diagonal|), rounded so that scaling by it loses no digit; 1 where the diagonal is zero."""
    size = np.where(diagonal != 0, abs(diagonal), 1.0)
    return np.asarray(2.0 ** -np.round(np.log2(size) / 2))
