"""Dynamic stiffness K + i loss + i w D - w^2 M of a sparse body, factorised at one frequency at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError

__all__ = ["DynamicStiffness", "ResonanceError"]

# Symmetric ordering; a diagonal pivot is used unless another entry is ten times as large.
_SYMMETRIC: dict[str, Any] = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.1,
    "options": {"SymmetricMode": True},
}


class ResonanceError(MatrixError):
    """The response is infinite at the frequency ``omega`` in rad/s."""

    def __init__(self, omega: float) -> None:
        super().__init__(f"the response is infinite at {omega / 2 / np.pi:.6g} Hz")
        self.omega = omega


@dataclass(frozen=True, eq=False)
class DynamicStiffness:
    """Matrices of a sparse body, all symmetric.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass.
    D, loss : (n, n) sparse array, optional
        Viscous damping and the imaginary part of the stiffness.
    """

    K: sp.csc_array
    M: sp.csc_array
    D: sp.csc_array | None = None
    loss: sp.csc_array | None = None

    @property
    def n(self) -> int:
        """Number of dofs."""
        return int(self.K.shape[0])

    def at(self, omega: float) -> sp.csc_array:
        """Matrix at a frequency in rad/s, (n, n) complex."""
        Z = self.K - omega**2 * self.M + 0j * self.K
        if self.D is not None:
            Z = Z + 1j * omega * self.D
        if self.loss is not None:
            Z = Z + 1j * self.loss
        return sp.csc_array(Z)

    def flexibility(self, load: NDArray[np.float64], omega: float) -> NDArray[np.complex128]:
        """Dynamic flexibility load^T Z^-1 load by a solve at one frequency.

        Parameters
        ----------
        load : (n, p) float64
        omega : float
            In rad/s.

        Returns
        -------
        Y : (p, p) complex128

        Raises
        ------
        ResonanceError
            If the matrix is singular.
        """
        return np.asarray(load.T @ self.solve(load, omega))

    def solve(self, load: NDArray[np.float64], omega: float) -> NDArray[np.complex128]:
        """Motions Z^-1 load (n, p) by a solve at one frequency; arguments and errors as of `flexibility`."""
        try:
            found = spla.splu(self.at(omega), **_SYMMETRIC).solve(np.asfortranarray(load, dtype=np.complex128))
        except RuntimeError:
            raise ResonanceError(omega) from None
        return np.asarray(found)
