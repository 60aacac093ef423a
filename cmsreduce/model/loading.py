"""What the neighbours of a body add to it where they are joined."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["InterfaceLoading"]


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
