"""The elastic modes of a body between the inputs and the outputs that a scene gives it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError

__all__ = ["ModalChannels"]


@dataclass(frozen=True, eq=False)
class ModalChannels:
    """q'' + 2 zeta w q' + w^2 q = B u, y = C1 q + C2 q': elastic modes only (theory sections 3 and 4).

    Parameters
    ----------
    body : str
        Name of the body, for messages.
    omega, zeta : (e,) float64
        Elastic frequencies in rad/s, positive, and damping ratios.
    B : (e, inputs) float64
        Modal input matrix: interface forces and actuators.
    C1, C2 : (outputs, e) float64
        Modal displacement and rate output matrices: sensors and interface motions. They need not have the same rows.

    Raises
    ------
    MatrixError
        If the shapes do not agree, or a frequency is zero or infinite: rigid and static modes are none of these.
    """

    body: str
    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    B: NDArray[np.float64]
    C1: NDArray[np.float64]
    C2: NDArray[np.float64]

    def __post_init__(self) -> None:
        e = self.omega.size
        if self.zeta.shape != (e,) or {self.B.shape[0], self.C1.shape[1], self.C2.shape[1]} != {e}:
            raise MatrixError(
                f"body '{self.body}': {e} modes need as many damping ratios, rows of B {self.B.shape} and columns of "
                f"C1 {self.C1.shape} and C2 {self.C2.shape}"
            )
        if not (np.isfinite(self.omega) & (self.omega > 0)).all():
            raise MatrixError(
                f"body '{self.body}': a rigid or static mode, with frequency zero or infinite, cannot be ranked; it is "
                "always kept"
            )

    @property
    def count(self) -> int:
        """Number of modes."""
        return int(self.omega.size)

    def only(self, modes: ArrayLike) -> ModalChannels:
        """The same inputs and outputs with some of the modes."""
        k = np.asarray(modes, dtype=np.int64)
        return ModalChannels(self.body, self.omega[k], self.zeta[k], self.B[k], self.C1[:, k], self.C2[:, k])
