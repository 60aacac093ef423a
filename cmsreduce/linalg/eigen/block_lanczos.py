"""Block Lanczos with thick restart for an operator that is symmetric in the M inner product."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import SearchSpace, by_rows, column_products, inner, inner_of_all, less, less_all, times

__all__ = ["BlockLanczos", "Operator", "Ritz"]

Operator = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Takes a block (n, k) to a block (n, k)."""

# A direction of a new block that orthogonalisation leaves less of than this is round-off, not a direction.
_NEW = 1e-7
# What is left of earlier vectors in a new one, relative to its length, beyond which it is orthogonalised once more. The
# Ritz values lose their digits in its square.
_SEMIORTHOGONAL = 1e-12
# What is left is taken out to round-off by one pass if it is no larger than this; then nothing has to be looked for
# again, and only the product with M is renewed.
_CORRECTED = 1e-6
_PASSES = 3
# A block whose Gram matrix has eigenvalues no farther apart than this is triangularised in place; no farther apart
# than the second, once is enough.
_INDEPENDENT, _ALIKE = 1e-12, 1e-3
# A direction this much shorter than the longest of its block is orthogonalised again by itself.
_SHORT = 1e-3
_SEED = 7


class Ritz(NamedTuple):
    """Eigenvalues of the operator as a basis sees them.

    Parameters
    ----------
    theta : (m,) float64
        Ritz values, the largest in size first.
    S : (m, m) float64
        Coefficients of the Ritz vectors in the basis.
    residual : (m,) float64
        ||A x - theta x||_M of the unit Ritz vector x: an eigenvalue of the operator lies this near to theta.
    """

    theta: NDArray[np.float64]
    S: NDArray[np.float64]
    residual: NDArray[np.float64]


class BlockLanczos:
    """Krylov basis of an operator A M that is self-adjoint in M, grown block by block.

    Parameters
    ----------
    operator : callable
        A, for instance the solve with K - sigma M: it is given M v.
    mass : callable
        v -> M v of a block.
    n : int
        Rows.
    block : int
        Columns of a block. Of what is repeated more often so many copies are seen; another run, with those deflated,
        sees as many more.
    columns : int
        Columns of the basis at most; a full one is restarted with its best Ritz vectors.
    sought : int
        Eigenvalues that are sought: so many Ritz vectors and half as many more outlive a restart.
    deflated : (n, r) float64, optional
        Vectors orthonormal in M that the basis is kept orthogonal to: rigid-body modes.
    start : (n, s) float64, optional
        Vectors in the range of the operator that the first block is made of; random ones if absent.

    Notes
    -----
    A block costs one call of the operator and one of the mass, rarely two: the products of the last two blocks with M
    are at hand, so the three-term recurrence needs none; what it loses of orthogonality is taken out once the product
    of the new block is known. Source: Grimes, Lewis and Simon, SIAM J. Matrix Anal. 15 (1994), 228-272; thick restart:
    Wu and Simon, SIAM J. Matrix Anal. 22 (2000), 602-616.
    """

    def __init__(
        self,
        operator: Operator,
        mass: Operator,
        n: int,
        *,
        block: int,
        columns: int,
        sought: int,
        deflated: NDArray[np.float64] | None = None,
        start: NDArray[np.float64] | None = None,
    ) -> None:
        self._operator, self._mass = operator, mass
        self._random = np.random.default_rng(_SEED)
        self._deflated = np.empty((n, 0)) if deflated is None else deflated
        room = n - self._deflated.shape[1]
        self._width = max(min(block, room // 4), 1)
        self._columns = min(max(columns, 3 * sought // 2 + 3 * self._width), room)
        self._sought = sought
        self._V = SearchSpace(n)
        self._T = np.empty((0, 0))
        # The newest block, not yet in the basis, and what it was before it was made orthonormal; the one before it.
        self._X, self._MX, self._border = self._first(start)
        self._last = self._last_mass = np.empty((n, 0))

    @property
    def m(self) -> int:
        """Columns of the basis."""
        return self._V.m

    @property
    def exhausted(self) -> bool:
        """Whether the basis spans all that the operator reaches from the blocks it was given."""
        return not self._X.shape[1]

    def step(self) -> None:
        """Apply the operator to the newest block and orthogonalise what comes of it against the basis."""
        if self.m + self._X.shape[1] > self._columns:
            self._restart()
        MX, m = self._MX, self.m
        X = self._X = self._V.append(self._X)
        W = by_rows(self._operator(MX))
        H, newest = np.zeros((self.m, X.shape[1])), slice(m - self._last.shape[1], None)
        H[newest] = inner_of_all([self._last_mass, MX], W)
        W = less_all(W, [self._last, X], H[newest])
        self._last, self._last_mass = X, MX
        before = abs(H).max()
        for _ in range(_PASSES):
            MW = self._mass(W)
            missed, rigid = self._V.inner(MW), inner(self._deflated, MW)
            H += missed
            W = less(self._V.taken_from(W, missed), self._deflated, rigid)
            left = max(float(np.sqrt(max(column_products(W, MW).max(), 0.0))), _NEW * before)
            worst = max(abs(missed).max(), abs(rigid).max(initial=0.0))
            if worst <= _SEMIORTHOGONAL * left:
                break
            if worst <= _CORRECTED * left:
                MW = self._mass(W)
                break
        T = np.zeros((self.m, self.m))
        T[:m, :m] = self._T
        T[:, m:], T[m:, :] = H, H.T
        self._T = T
        self._X, self._MX, self._border = _orthonormal(W, MW, _NEW * before)
        if self._border.size and la.svdvals(self._border)[-1] < _SHORT * left:
            # Made unit, the shortest direction shows what was missed of it beside the longest.
            self._X, self._MX = self._cleared(self._X, self._MX)

    def ritz(self) -> Ritz:
        """Ritz values of the basis, the largest in size first."""
        # Divide and conquer: a third less time than scipy's choice, from sixty columns on.
        theta, S = la.eigh(self._T, driver="evd")
        order = np.argsort(-abs(theta), kind="stable")
        theta, S = theta[order], S[:, order]
        return Ritz(theta, S, np.linalg.norm(self._border @ S[self.m - self._border.shape[1] :], axis=0))

    def vectors(self, ritz: Ritz, chosen: NDArray[np.int64]) -> NDArray[np.float64]:
        """Ritz vectors after one more application of the operator, which the basis holds already (n, k).

        It takes out of them what has no mass (Nour-Omid et al., Int. J. Numer. Meth. Eng. 1987).
        """
        S, theta = ritz.S[:, chosen], ritz.theta[chosen]
        tail = self._border @ S[self.m - self._border.shape[1] :]
        return self._V.combined(np.vstack([S, tail / theta]), self._X)

    def _restart(self) -> None:
        """Shrink the basis to its best Ritz vectors; the newest block couples them to what follows."""
        ritz = self.ritz()
        kept = min(max(3 * self._sought // 2, self._width), self._columns - 2 * self._width)
        self._V.shrink(np.asfortranarray(ritz.S[:, :kept]))
        self._T = np.diag(ritz.theta[:kept])
        self._last = self._last_mass = self._last[:, :0]

    def _first(
        self, start: NDArray[np.float64] | None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """A block in the range of the operator, orthogonal to what is deflated."""
        n = self._V.n
        if start is None:
            # Smoothed first: rough vectors in the basis leave their rounding in all others.
            X = self._operator(self._mass(self._random.standard_normal((n, self._width))))
        else:
            X = start @ self._random.standard_normal((start.shape[1], self._width))
        X = by_rows(X)
        MX = self._mass(X)
        # What is deflated is taken out twice, like all that is orthogonalised.
        for _ in range(_PASSES if self._deflated.size else 1):
            X, MX = self._cleared(X, MX)
        return X, MX, np.empty((X.shape[1], 0))

    def _cleared(
        self, X: NDArray[np.float64], MX: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Orthonormal basis, and its product with M, of what a block has outside of the basis."""
        size = float(np.sqrt(max(column_products(X, MX).max(initial=0.0), 0.0)))
        if self.m or self._deflated.size:
            missed, rigid = self._V.inner(MX), inner(self._deflated, MX)
            X = less(self._V.taken_from(X.copy(), missed), self._deflated, rigid)
            MX = self._mass(X)
        X, _, _ = _orthonormal(X, MX, _NEW * size)
        return X, self._mass(X)


def _orthonormal(
    W: NDArray[np.float64], MW: NDArray[np.float64], least: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Orthonormal basis X of the span of a block in M, M X, and the coefficients B of W = X B.

    Directions no longer than ``least`` are left out.
    """
    B = np.eye(W.shape[1])
    for _ in range(2):
        G = inner(W, MW)
        squared, U = la.eigh((G + G.T) / 2) if G.size else (np.empty(0), G)
        kept = squared > max(least**2, _INDEPENDENT * squared.max(initial=0.0))
        if kept.all() and kept.size:
            R = la.cholesky((G + G.T) / 2)
            inverse = la.solve_triangular(R, np.eye(kept.size))
            W, MW, B = times(W, inverse), times(MW, inverse), R @ B
            if squared[0] > _ALIKE * squared[-1]:
                break
        else:
            kept = squared > least**2
            root = np.sqrt(squared[kept])
            W, MW = by_rows(times(W, U[:, kept] / root)), by_rows(times(MW, U[:, kept] / root))
            B = (root[:, None] * U[:, kept].T) @ B
        least = 0.0
    return W, MW, B
