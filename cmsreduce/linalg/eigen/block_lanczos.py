"""Block Lanczos with thick restart for an operator that is symmetric in the M inner product."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import SearchSpace, by_rows, column_products, inner, inner_of_all, less, less_all, times

__all__ = ["BlockLanczos", "Operator", "Ritz"]

Array = NDArray[np.float64]
Operator = Callable[[Array], Array]
"""Maps a block (n, k) to a block (n, k)."""

# A vector of a new block is round-off if orthogonalisation leaves less than this of its length.
_NEW = 1e-7
# A new block is orthogonalised again if its products with the basis exceed this share of its length. The error of the
# Ritz values is of the square of this.
_SEMIORTHOGONAL = 1e-12
# One more pass reaches round-off if the products are no larger than this; only the product with M is then renewed.
_CORRECTED = 1e-6
_PASSES = 3
# Cholesky's method is used if the eigenvalue ratio of the Gram matrix exceeds the first number; it is not repeated if
# the ratio exceeds the second.
_INDEPENDENT, _ALIKE = 1e-12, 1e-3
# A block with a vector this much shorter than the longest is orthogonalised again after scaling to unit length.
_SHORT = 1e-3
_SEED = 7


class Ritz(NamedTuple):
    """Ritz values of a basis: its approximate eigenvalues of the operator.

    Parameters
    ----------
    theta : (m,) float64
        Ritz values, the largest in magnitude first.
    S : (m, m) float64
        Coefficients of the Ritz vectors in the basis.
    residual : (m,) float64
        ||A x - theta x||_M of the unit Ritz vector x. The distance of theta to an eigenvalue is no larger.
    """

    theta: Array
    S: Array
    residual: Array


class BlockLanczos:
    """Krylov basis of an operator A M that is self-adjoint in M; it grows block by block.

    Parameters
    ----------
    operator : callable
        A, applied to M v; for instance the solve with K - sigma M.
    mass : callable
        Product of M and a block.
    n : int
        Rows.
    block : int
        Columns of a block. One run finds at most this many copies of a repeated eigenvalue. Another run, with these
        copies deflated, finds as many more.
    columns : int
        Largest number of columns of the basis. A full basis is restarted with its best Ritz vectors.
    sought : int
        Eigenvalues that are sought. A restart keeps 1.5 times as many Ritz vectors.
    deflated : (n, r) float64, optional
        Vectors orthonormal in M to which the basis stays orthogonal, such as rigid-body modes.

    Notes
    -----
    A block costs one product with the operator and one with the mass, rarely two. The products of the last two blocks
    with M are stored, so the three-term recurrence needs no further ones. The loss of orthogonality is removed once the
    product of M and the new block is known. Source: Grimes, Lewis and Simon, SIAM J. Matrix Anal. 15 (1994), 228-272;
    thick restart: Wu and Simon, SIAM J. Matrix Anal. 22 (2000), 602-616.
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
        deflated: Array | None = None,
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
        # The newest block, not yet in the basis, with its coefficients before orthonormalisation; then the last block.
        self._X, self._MX, self._border = self._first()
        self._last = self._last_mass = np.empty((n, 0))

    @property
    def m(self) -> int:
        """Columns of the basis."""
        return self._V.m

    @property
    def exhausted(self) -> bool:
        """True if the basis spans the complete Krylov space of the first block."""
        return not self._X.shape[1]

    def step(self) -> None:
        """Apply the operator to the newest block and orthogonalise the result against the basis."""
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
            # At unit length the shortest vector shows components that were below round-off of the longest.
            self._X, self._MX = self._cleared(self._X, self._MX)

    def ritz(self) -> Ritz:
        """Ritz values of the basis, the largest in magnitude first."""
        # From sixty columns on, divide and conquer takes a third less time than scipy's default.
        theta, S = la.eigh(self._T, driver="evd")
        order = np.argsort(-abs(theta), kind="stable")
        theta, S = theta[order], S[:, order]
        return Ritz(theta, S, np.linalg.norm(self._border @ S[self.m - self._border.shape[1] :], axis=0))

    def vectors(self, ritz: Ritz, chosen: NDArray[np.int64]) -> Array:
        """Ritz vectors after one more application of the operator (n, k), computed from the basis without a solve.

        This removes components without mass (Nour-Omid et al., Int. J. Numer. Meth. Eng. 1987).
        """
        S, theta = ritz.S[:, chosen], ritz.theta[chosen]
        tail = self._border @ S[self.m - self._border.shape[1] :]
        return self._V.combined(np.vstack([S, tail / theta]), self._X)

    def _restart(self) -> None:
        """Shrink the basis to its best Ritz vectors; the newest block couples them to the next ones."""
        ritz = self.ritz()
        retained = min(max(3 * self._sought // 2, self._width), self._columns - 2 * self._width)
        self._V.shrink(np.asfortranarray(ritz.S[:, :retained]))
        self._T = np.diag(ritz.theta[:retained])
        self._last = self._last_mass = self._last[:, :0]

    def _first(self) -> tuple[Array, Array, Array]:
        """Block in the range of the operator, orthogonal to the deflated vectors."""
        n = self._V.n
        # The rounding of a rough vector would spread to all others, so the operator smooths it first.
        X = by_rows(self._operator(self._mass(self._random.standard_normal((n, self._width)))))
        MX = self._mass(X)
        for _ in range(_PASSES if self._deflated.size else 1):
            X, MX = self._cleared(X, MX)
        return X, MX, np.empty((X.shape[1], 0))

    def _cleared(self, X: Array, MX: Array) -> tuple[Array, Array]:
        """Orthonormal basis of the part of a block outside the basis, and its product with M."""
        size = float(np.sqrt(max(column_products(X, MX).max(initial=0.0), 0.0)))
        if self.m or self._deflated.size:
            missed, rigid = self._V.inner(MX), inner(self._deflated, MX)
            X = less(self._V.taken_from(X.copy(), missed), self._deflated, rigid)
            MX = self._mass(X)
        X, _, _ = _orthonormal(X, MX, _NEW * size)
        return X, self._mass(X)


def _orthonormal(W: Array, MW: Array, least: float) -> tuple[Array, Array, Array]:
    """Basis X of the span of a block, orthonormal in M, the product M X, and the coefficients B of W = X B.

    Vectors no longer than ``least`` are left out.
    """
    B = np.eye(W.shape[1])
    for _ in range(2):
        G = inner(W, MW)
        squared, U = la.eigh((G + G.T) / 2) if G.size else (np.empty(0), G)
        independent = squared > max(least**2, _INDEPENDENT * squared.max(initial=0.0))
        if independent.all() and independent.size:
            R = la.cholesky((G + G.T) / 2)
            inverse = la.solve_triangular(R, np.eye(independent.size))
            W, MW, B = times(W, inverse), times(MW, inverse), R @ B
            if squared[0] > _ALIKE * squared[-1]:
                break
        else:
            independent = squared > least**2
            root = np.sqrt(squared[independent])
            W, MW = by_rows(times(W, U[:, independent] / root)), by_rows(times(MW, U[:, independent] / root))
            B = (root[:, None] * U[:, independent].T) @ B
        least = 0.0
    return W, MW, B
