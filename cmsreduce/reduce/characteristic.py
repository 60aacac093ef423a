"""Interface reduction: characteristic constraint modes replace the constraint modes of interface dofs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import elastic_and_massless, orthonormal
from cmsreduce.model import repeated_groups

__all__ = ["InterfaceMotions", "InterfaceReduction"]

# Interface motions of the rigid modes and modes of the interface are independent when the others leave more than this
# share of each.
_INDEPENDENT = 1e-9


@dataclass(frozen=True, eq=False)
class InterfaceReduction:
    """Reduction of an interface with many dofs to a few motions.

    Parameters
    ----------
    cutoff_hz : float
        Characteristic constraint modes are kept up to this frequency; repeated ones are never split.
    rows : (t,) int64, optional
        Dofs that are reduced; all of the i-set if absent. Each of the others keeps its constraint mode.
    shapes : (t, c) float64, optional
        Motions of these dofs that the basis holds instead of the modes of the interface: two bodies that are joined
        there need the same motions.
    """

    cutoff_hz: float
    rows: NDArray[np.int64] | None = None
    shapes: NDArray[np.float64] | None = None

    def positions(self, interface: NDArray[np.int64]) -> NDArray[np.int64]:
        """Positions in the i-set (i,) of the dofs that are reduced, in the order of ``rows``."""
        if self.rows is None:
            return np.arange(interface.size)
        place = {int(row): k for k, row in enumerate(interface)}
        return np.array([place[int(row)] for row in self.rows if int(row) in place], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class InterfaceMotions:
    """Motions of the i-set that a basis holds.

    Parameters
    ----------
    shapes : (i, b) float64
        Motions of the i-set: single dofs first, then characteristic shapes.
    single : (s,) int64
        Positions in the i-set of the dofs that keep a constraint mode each.
    frequency_hz : (b - s,) float64
        Frequencies of the characteristic shapes, 0 for rigid ones, NaN where they were given.
    """

    shapes: NDArray[np.float64]
    single: NDArray[np.int64]
    frequency_hz: NDArray[np.float64]

    @property
    def labels(self) -> list[str]:
        """Names of the characteristic shapes."""
        return [f"characteristic {number + 1}" for number in range(self.frequency_hz.size)]

    @classmethod
    def single_dofs(cls, i: int) -> InterfaceMotions:
        """One motion for each of i dofs, by itself."""
        return cls(np.eye(i), np.arange(i), np.empty(0))

    @classmethod
    def reduced(
        cls,
        K: NDArray[np.float64],
        M: NDArray[np.float64],
        rigid: NDArray[np.float64],
        many: NDArray[np.int64],
        reduction: InterfaceReduction,
        rounding: float,
    ) -> InterfaceMotions:
        """Craig-Bampton of the interface itself: single dofs, and modes of the others with the single dofs held.

        Parameters
        ----------
        K, M : (i, i) float64
            Stiffness and mass condensed to the i-set.
        rigid : (i, r) float64
            Rigid-body modes on the i-set, orthonormal in M.
        many : (t,) int64
            Positions in the i-set of the dofs to reduce.
        reduction : InterfaceReduction
            Cutoff, or the shapes themselves.
        rounding : float
            Relative rounding of the body's matrices.

        Notes
        -----
        Source: Castanier, Tan and Pierre, AIAA J. 39 (2001) 1182-1187: eigenvectors of the reduced interface pencil.
        """
        single = np.setdiff1d(np.arange(K.shape[0]), many)
        Ktt, Mtt = K[np.ix_(many, many)], M[np.ix_(many, many)]
        # Rigid motions that leave the single dofs at rest are modes of frequency zero.
        still = la.null_space(rigid[single], rcond=_INDEPENDENT) if rigid.shape[1] else np.empty((0, 0))
        at_rest = rigid[many] @ still if still.size else np.empty((many.size, 0))
        at_rest = orthonormal(at_rest, at_rest.T @ Mtt @ at_rest)
        lam, X, N = elastic_and_massless(Ktt, Mtt, at_rest, rounding)
        # All shapes of a repeated mode at the cutoff are kept.
        w = np.sqrt(lam)
        below, group = int(np.count_nonzero(w <= 2 * np.pi * reduction.cutoff_hz)), repeated_groups(w)
        kept = int(np.count_nonzero(group <= group[below - 1])) if below else 0
        U = np.hstack([at_rest, X[:, :kept]])
        frequency = np.concatenate([np.zeros(at_rest.shape[1]), w[:kept] / (2 * np.pi)])
        if reduction.shapes is not None:
            U, frequency = reduction.shapes, np.full(reduction.shapes.shape[1], np.nan)
            if U.shape[0] != many.size:
                raise MatrixError(
                    f"interface reduction: the shapes have {U.shape[0]} rows, but {many.size} dofs are reduced"
                )
        # The reduced dofs follow the single ones statically; the rigid part of this motion is among the modes.
        Kts = K[np.ix_(many, single)]
        follow = -X @ ((X.T @ Kts) / lam[:, None]) - N @ (N.T @ Kts)
        shapes = np.zeros((K.shape[0], single.size + U.shape[1]))
        shapes[single, np.arange(single.size)] = 1.0
        shapes[many, : single.size], shapes[many, single.size :] = follow, U
        return cls(shapes, single, frequency)
