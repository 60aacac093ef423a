"""Receptances of bodies in uncoupled modes: sums over the modes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble.response.by_rows import ByRows, products
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.response import ResonanceError, frequency_blocks
from cmsreduce.model import Matrix, Substructure

__all__ = ["ByModes", "is_diagonal", "modal_weights", "named", "resonant"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Memory of the mode amplitudes of a block of frequencies, which stay in the cache.
_CACHED_BYTES = 2**21


@dataclass(frozen=True, eq=False)
class ByModes(ByRows):
    """Receptance of a body in uncoupled modes, a sum over them.

    Parameters
    ----------
    sub : Substructure
        The body.
    L : (p, m) float64
        Rows of the point motions.
    """

    sub: Substructure
    L: Real

    @property
    def motions(self) -> int:
        """Number of motions."""
        return int(self.L.shape[0])

    def __call__(self, omega: Real) -> Complex:
        """Receptances (f, p, p) at frequencies (f,) in rad/s.

        Raises
        ------
        MatrixError
            If a frequency hits a mode without damping.
        """
        with named(self.sub):
            return _by_modes(self.sub, self.L, omega)

    def add(self, G: Complex, left: Real, right: Real, omega: Real, loads: Complex | None = None) -> None:
        """Add left Y right^T, or left Y right^T loads, to an array; see `ByRows.add`."""
        rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
        motion, force = left[rows] @ self.L, (right[columns] @ self.L).T
        if not (motion.size and force.size):
            return
        into = columns if loads is None else np.arange(loads.shape[1])
        for part in frequency_blocks(omega.size, 16 * self.sub.m * (3 + into.size), _CACHED_BYTES):
            with named(self.sub):
                weights = modal_weights(self.sub, omega[part]).T
            if loads is None:
                acting: Real | Complex = force[:, :, None]
            else:
                acting = products(force, np.ascontiguousarray(loads[columns, :, part]))
            amplitudes = np.ascontiguousarray(acting * weights[:, None])
            G[rows[:, None], into, part] += products(motion, amplitudes)


def is_diagonal(sub: Substructure) -> bool:
    """Tell if a body is in uncoupled modes."""
    parts = [part for part in (sub.M, sub.K, sub.D, sub.loss) if part is not None]
    if sub.omega is None:
        return False
    return all(sp.csc_array(part).nnz == np.count_nonzero(_diagonal(part)) for part in parts)


def modal_weights(sub: Substructure, omega: Real, columns: NDArray[np.int64] | None = None) -> Complex:
    """Amplitudes of the modes of a body under unit modal forces (f, m), or of some uncoupled ones (f, k).

    Raises
    ------
    ResonanceError
        If a frequency hits a mode without damping.
    """
    own = slice(None) if columns is None else columns
    m, k = _diagonal(sub.M)[own], _diagonal(sub.K)[own]
    d = _diagonal(sub.D)[own] if sub.D is not None else np.zeros(m.size)
    g = _diagonal(sub.loss)[own] if sub.loss is not None else np.zeros(m.size)
    real, imaginary = k[:, None] - m[:, None] * omega**2, g[:, None] + d[:, None] * omega
    square = real**2 + imaginary**2
    if not square.all():
        raise ResonanceError(float(omega[(square == 0).any(axis=0)][0]))
    weights = np.empty(square.shape, dtype=np.complex128)
    np.divide(real, square, out=weights.real)
    np.divide(-imaginary, square, out=weights.imag)
    return weights.T


def resonant(sub: Substructure, error: ResonanceError) -> MatrixError:
    """Error for a body without damping that is driven at its resonance, or at 0 Hz where it moves freely."""
    if error.omega == 0:
        return MatrixError(
            f"body '{sub.name}' can move freely, so its response at 0 Hz is infinite; take frequencies above zero"
        )
    return MatrixError(
        f"body '{sub.name}' has no damping and resonates at {error.omega / 2 / np.pi:.6g} Hz, where its "
        "response is infinite; give it `damping:`, or move the frequency grid"
    )


@contextmanager
def named(sub: Substructure) -> Iterator[None]:
    """Name the body in an error for a frequency that hits one of its resonances."""
    try:
        yield
    except ResonanceError as error:
        raise resonant(sub, error) from None


def _by_modes(sub: Substructure, L: Real, omega: Real) -> Complex:
    p = L.shape[0]
    Y = np.empty((p, p, omega.size), dtype=np.complex128)
    row, column = np.triu_indices(p)
    for part in frequency_blocks(omega.size, 16 * 3 * sub.m, _CACHED_BYTES):
        weights = modal_weights(sub, omega[part]).T.view(np.float64)
        for pairs in frequency_blocks(row.size, 8 * (sub.m + weights.shape[1]), _CACHED_BYTES):
            a, b = row[pairs], column[pairs]
            Y[a, b, part] = Y[b, a, part] = ((L[a] * L[b]) @ weights).view(np.complex128)
    return Y.transpose(2, 0, 1)


def _diagonal(A: Matrix) -> Real:
    return np.asarray(A.diagonal())
