"""Dynamic stiffness K + i loss + i w D - w^2 M of a sparse body, factorised at one frequency at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import by_columns, one_norm
from cmsreduce.linalg.response.damped_solve import through_real_factor
from cmsreduce.linalg.sparse import BLOCK, NotPositiveDefiniteError, factorise
from cmsreduce.model import is_gyroscopic

__all__ = ["DynamicStiffness", "ResonanceError"]

# For gyroscopic forces. Symmetric ordering; a diagonal pivot is used unless another entry is ten times as large.
_GYROSCOPIC: dict[str, Any] = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.1,
    "options": {"SymmetricMode": True},
}


# Steps of refinement, and residual relative to the size of the matrix times the motions: rounding, and one that leaves
# the motions digits beside all but the sharpest resonances.
_REFINEMENTS, _ROUNDING, _TRUSTED = 3, 1e-14, 1e-10


class ResonanceError(MatrixError):
    """The response is infinite at the frequency ``omega`` in rad/s."""

    def __init__(self, omega: float) -> None:
        super().__init__(f"the response is infinite at {omega / 2 / np.pi:.6g} Hz")
        self.omega = omega


@dataclass(frozen=True, eq=False)
class DynamicStiffness:
    """Matrices of a sparse body, symmetric except for gyroscopic forces.

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
        A, C = self._parts(omega)
        return sp.csc_array(A + (0j * A if C is None else 1j * C))

    def flexibility(
        self, load: NDArray[np.float64], omega: float, seen: NDArray[np.float64] | None = None
    ) -> NDArray[np.complex128]:
        """Dynamic flexibility load^T Z^-1 load, or seen^T Z^-1 load, by a solve at one frequency.

        Parameters
        ----------
        load : (n, p) float64
        omega : float
            In rad/s.
        seen : (n, s) float64, optional
            Motions, as loads.

        Returns
        -------
        Y : (p, p) or (s, p) complex128

        Raises
        ------
        ResonanceError
            If the matrix is singular.
        MatrixError
            If the motions do not meet the equations.
        """
        return np.asarray((load if seen is None else seen).T @ self.solve(load, omega))

    def solve(self, load: NDArray[np.float64], omega: float) -> NDArray[np.complex128]:
        """Motions Z^-1 load (n, p) by a solve at one frequency; arguments and errors as of `flexibility`.

        Notes
        -----
        With Z = A + i C a real factor serves where the damping is small. Else, with x = y + i z, the real equations
        [A -C; -C -A] [y; z] = [load; 0] are symmetric, so that `factorise` takes its order, its memory limit and its
        solvers. A local C adds little to two factors of A. The residual is measured, and the motions are refined.
        """
        (A, C), Z = self._parts(omega), self.at(omega)
        if C is not None and is_gyroscopic(self.D):
            try:
                factor = spla.splu(Z, **_GYROSCOPIC)
            except RuntimeError:
                raise ResonanceError(omega) from None
            return _refined(Z, lambda f: np.array(factor.solve(f), dtype=np.complex128), load, omega)
        if C is not None and (moved := through_real_factor(A, C, load)) is not None:
            return moved
        real = A if C is None else sp.csc_array(sp.block_array([[A, -C], [-C, -A]]))
        try:
            solve = factorise(real, definite=False, what="the dynamic stiffness")
        except NotPositiveDefiniteError:
            raise ResonanceError(omega) from None
        n = self.n

        def motions(f: NDArray[np.complex128]) -> NDArray[np.complex128]:
            if C is None:
                return np.asarray(solve(by_columns(f.real)), dtype=np.complex128)
            x = solve(by_columns(np.vstack([f.real, -f.imag])))
            return np.asarray(x[:n] + 1j * x[n:])

        found = np.empty(load.shape, dtype=np.complex128)
        for first in range(0, load.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            found[:, part] = _refined(Z, motions, load[:, part], omega)
        return found

    def _parts(self, omega: float) -> tuple[sp.csc_array, sp.csc_array | None]:
        """Real part and imaginary part of the matrix, the second None without damping."""
        A, C = sp.csc_array(self.K - omega**2 * self.M), self.loss
        if self.D is not None:
            drag = omega * self.D
            C = drag if C is None else C + drag
        return A, C if C is None else sp.csc_array(C)


def _refined(
    Z: sp.csc_array,
    solve: Callable[[NDArray[np.complex128]], NDArray[np.complex128]],
    load: NDArray[np.float64],
    omega: float,
) -> NDArray[np.complex128]:
    """Motions Z^-1 load by a solve, whose residual is measured, and refined where it is more than rounding."""
    size, x = one_norm(Z), np.zeros(load.shape, dtype=np.complex128)
    left = load.astype(np.complex128)
    for _ in range(1 + _REFINEMENTS):
        x = x + solve(left)
        left = np.asarray(load - Z @ x, dtype=np.complex128)
        share = np.linalg.norm(left, axis=0)
        allowed = size * np.linalg.norm(x, axis=0)
        if (share <= _ROUNDING * allowed).all():
            return x
    if not np.isfinite(x).all():
        raise ResonanceError(omega)
    if not (share <= _TRUSTED * allowed).all():
        raise MatrixError(
            f"the response at {omega / 2 / np.pi:.6g} Hz does not meet its equations: a residual of "
            f"{float((share / allowed).max()):.1e} remains. Set solver.precision to double, or take another "
            "solver.backend"
        )
    return x
