"""What the neighbours of a body add to it where they are joined.

What hangs on an interface of a body, as one rigid mass: data of an augmented body.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = [
    "InterfaceLoading",
    "OutboardMass",
]


@dataclass(frozen=True, eq=False)
class InterfaceLoading:
    """Stiffness and mass of the neighbours, condensed to the i-set of a body.

    Parameters
    ----------
    K, M : (i + f, i + f) float64
        Stiffness and mass over the rows of the i-set, in order, and then over f motions of the neighbours that the
        i-set does not hold; f is zero where it holds them all.
    neighbours : tuple of str
        Bodies that load it.
    configuration : str
        Setting of the joints the loading was taken in.
    grounded : (h,) int64
        Rows of the i-set, by position, that the ground holds.

    Raises
    ------
    MatrixError
        If the matrices are not square, of one size and symmetric.
    """

    K: NDArray[np.float64]
    M: NDArray[np.float64]
    neighbours: tuple[str, ...] = ()
    configuration: str = "as built"
    grounded: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __post_init__(self) -> None:
        K, M = (np.asarray(A, dtype=np.float64) for A in (self.K, self.M))
        if K.shape != M.shape or K.ndim != 2 or K.shape[0] != K.shape[1]:
            raise MatrixError(f"interface loading: K is {K.shape} and M {M.shape}; two square matrices are expected")
        object.__setattr__(self, "K", (K + K.T) / 2)
        object.__setattr__(self, "M", (M + M.T) / 2)

    @property
    def size(self) -> int:
        """Rows of the i-set and free motions together."""
        return int(self.K.shape[0])


@dataclass(frozen=True, eq=False)
class OutboardMass:
    """Everything outboard of an interface, rigid and as built.

    Parameters
    ----------
    interface : str
        Interface of the inboard body.
    point : (3,) float64
        Its first node in the inboard body's basic frame: what follows is about it, along that body's basic axes.
    rigid_mass : (6, 6) float64
        Mass matrix of three translations and three rotations, inertias of joints included.
    bodies : tuple of str
        What it is the mass of.
    """

    interface: str
    point: NDArray[np.float64]
    rigid_mass: NDArray[np.float64]
    bodies: tuple[str, ...]

    @property
    def mass(self) -> float:
        """Mass."""
        return float(self.rigid_mass[0, 0])

    @property
    def first_moment(self) -> NDArray[np.float64]:
        """Int r dm (3,), r from the point."""
        M = self.rigid_mass
        return np.array([M[1, 5] - M[2, 4], M[2, 3] - M[0, 5], M[0, 4] - M[1, 3]]) / 2

    @property
    def inertia(self) -> NDArray[np.float64]:
        """Int (r.r 1 - r r^T) dm (3, 3) about the point."""
        return self.rigid_mass[3:, 3:]
