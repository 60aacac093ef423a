"""A small model of the dynamic flexibility of a sparse body at any number of frequencies, with an error bound.

The Galerkin model of Y = F^T Z^-1 F, with real shapes V and symmetric Z, has the error r^T Z^-1 r exactly, where
r = F - Z V y is the residual of the loads. If all modes below w_c are among the shapes, r has no part along them. On
the rest K - w^2 M is at least (1 - w^2/w_c^2) K, so that

    |error_ab| <= |r_a| |r_b| / (1 - w^2/w_c^2),   |r|^2 = r^H K^-1 r.

The response seen at a motion b that is no load, of which the shapes may know nothing, has this error with |r_b| at most
the static flexibility of the modes above w_c. These are a part of the absolute modal terms of Y_bb.

This holds at resonances between the sampled frequencies too. It is a bound for damping that does not couple the modes.
For other damping it neglects the coupling through the modes, which is of the order of the damping.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.response.dynamic_stiffness import ResonanceError

__all__ = ["Evaluation", "FlexibilityModel", "Residual", "frequency_blocks"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The size of a receptance is at least this share of the sum of its absolute modal terms, so that the error is not
# measured relative to a deep antiresonance.
_ANTIRESONANCE = 1e-3
# Size of a load of zero, so that no quotient is undefined.
_LEAST = 1e-280
# If an undamped mode is nearer to the frequency than this, relative to it, the rounding of K determines the response.
_HIT = 1e-10
# Memory of the amplitudes of one block of frequencies, in bytes.
_BLOCK_BYTES = 2**26


def frequency_blocks(count: int, bytes_each: int, limit: int = _BLOCK_BYTES) -> Iterator[slice]:
    """Slices of ``count`` frequencies, each as long as the memory limit allows and never empty.

    >>> [(part.start, part.stop) for part in frequency_blocks(5, 8, 16)]
    [(0, 2), (2, 4), (4, 6)]
    """
    step = max(1, limit // max(bytes_each, 1))
    return (slice(start, start + step) for start in range(0, count, step))


@dataclass(frozen=True, eq=False)
class Residual:
    """Residual of the loads, in q coordinates whose Euclidean norm is the norm in K^-1.

    Parameters
    ----------
    load : (q, p) float64
        Coordinates of the loads.
    mass, loss, drag : (q, k) float64
        Coordinates of w^2 M, -i loss and -i w D times the shapes, without these factors.
    """

    load: Real
    mass: Real
    loss: Real
    drag: Real

    def __call__(self, omega: Real, y: Complex) -> Complex:
        """Residuals (f, q, p) for amplitudes y (f, k, p)."""
        w = omega[:, None, None]
        r = np.broadcast_to(self.load.astype(np.complex128), (omega.size, *self.load.shape)).copy()
        for factor, part in ((w**2, self.mass), (np.full_like(w, -1j, complex), self.loss), (-1j * w, self.drag)):
            used = np.flatnonzero(part.any(axis=0))
            if used.size:
                r += factor * _times(part[:, used], np.ascontiguousarray(y[:, used]))
        return r


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Results of the model at some frequencies.

    Parameters
    ----------
    Y : (f, p, p) complex128
        Dynamic flexibility.
    error : (f,) float64
        Upper bound of |error_ab| / sqrt(size_a size_b), of loads a, and of loads or of motions b that are seen.
    size : (f, p) float64
        |Y_aa|, a thousandth of the sum of its absolute modal terms, or the energy of its residual: the largest of them.
    residual : (f, q, p) complex128
        Residuals of the loads.
    """

    Y: Complex
    error: Real
    size: Real
    residual: Complex


@dataclass(frozen=True, eq=False)
class FlexibilityModel:
    """Galerkin model over k shapes in which stiffness and mass are diagonal.

    Parameters
    ----------
    load : (k, p) float64
        Loads on the shapes.
    stiffness, mass : (k,) float64
        Diagonals.
    drag, loss : (k,) or (k, k) float64
        Viscous damping and loss; the diagonals only if the matrices are diagonal.
    residual : Residual
        Residual of the loads.
    ceiling : float
        Frequency in rad/s up to which every mode is among the shapes.
    seen : (k, s) float64, optional
        Motions at which the responses to the loads are seen, on the shapes; absent if they are the loads' own.
    beyond : (s,) float64, optional
        Static flexibility of these motions beyond the shapes.
    """

    load: Real
    stiffness: Real
    mass: Real
    drag: Real
    loss: Real
    residual: Residual
    ceiling: float
    seen: Real | None = None
    beyond: Real | None = None

    @property
    def k(self) -> int:
        """Number of shapes."""
        return int(self.load.shape[0])

    @property
    def bytes_each(self) -> int:
        """Memory in bytes of the evaluation at one frequency."""
        p, q = self.load.shape[1], self.residual.load.shape[0]
        full = self.k if self.coupled else 0
        return int(16 * (self.k * (full + p) + 2 * q * p + p * p))

    def __call__(self, omega: Real) -> Evaluation:
        """Evaluate at frequencies in rad/s, all at once; `frequency_blocks` with ``bytes_each`` limits the memory.

        Raises
        ------
        ResonanceError
            At a resonance of an undamped mode.
        """
        y = self.amplitudes(omega)
        Y = _times(self.load.T, y)
        size = np.maximum(abs(np.einsum("faa->fa", Y)), self.least(omega, self.load))
        r = self.residual(omega, y)
        square = np.einsum("fqa,fqa->fa", r.real, r.real) + np.einsum("fqa,fqa->fa", r.imag, r.imag)
        # Without any shape, as for a body that is stiff in the band, the model is zero.
        size = np.maximum(size, np.maximum(square, _LEAST))
        share = (square / size).max(axis=1, initial=0.0)
        error = (share if self.seen is None else np.sqrt(share / _ANTIRESONANCE)) * self.amplification(omega)
        return Evaluation(Y, error, size, r)

    def least(self, omega: Real, load: Real) -> Real:
        """Least sizes (f, p) of the receptances at loads on the shapes (k, p): a share of their modal terms."""
        return np.asarray(_ANTIRESONANCE * (1 / abs(self._diagonal(omega))) @ load**2)

    def weight(self, omega: Real, size: Real, allowed: float) -> Real:
        """Factors (f, p) that make the squared residuals of the loads one where the error is the allowed one."""
        share = self.amplification(omega)[:, None] / allowed
        return np.asarray((share if self.seen is None else share**2 / _ANTIRESONANCE) / size)

    @property
    def coupled(self) -> bool:
        """True if damping couples the shapes."""
        return self.drag.ndim == 2 or self.loss.ndim == 2

    def amplitudes(self, omega: Real, load: Real | None = None) -> Complex:
        """Amplitudes of the shapes under the loads, or under others on the shapes (k, p), (f, k, p)."""
        load = self.load if load is None else load
        hit = self.hits(omega)
        if hit.any():
            raise ResonanceError(float(omega[hit][0]))
        if not self.coupled:
            return np.asarray(load / self._diagonal(omega)[:, :, None])
        w = omega[:, None, None]
        Z = 1j * (w * _full(self.drag) + _full(self.loss))
        Z[:, range(self.k), range(self.k)] += self.stiffness - omega[:, None] ** 2 * self.mass
        F = np.broadcast_to(load.astype(np.complex128), (omega.size, *load.shape))
        return np.asarray(np.linalg.solve(Z, F), dtype=np.complex128)

    def detuning(self, omega: Real) -> Real:
        """Distance to the nearest resonance (f,): least |1 - w^2 m| of the shapes, which have unit stiffness."""
        elastic = self.stiffness > 0
        return np.asarray(abs(1 - omega[:, None] ** 2 * self.mass[elastic]).min(axis=1, initial=1.0))

    def amplification(self, omega: Real) -> Real:
        """Largest ratio of dynamic to static response of modes above the ceiling; infinite from the ceiling on."""
        below = np.maximum(1 - (omega / self.ceiling) ** 2, 0.0)
        return np.asarray(np.divide(1.0, below, out=np.full(omega.shape, np.inf), where=below > 0))

    def hits(self, omega: Real) -> NDArray[np.bool_]:
        """True for frequencies that hit an undamped mode (f,)."""
        size = self.stiffness + omega[:, None] ** 2 * self.mass
        return np.asarray((abs(self._diagonal(omega)) <= _HIT * size).any(axis=1))

    def _diagonal(self, omega: Real) -> Complex:
        drag, loss = (A if A.ndim == 1 else np.diagonal(A) for A in (self.drag, self.loss))
        w = omega[:, None]
        return np.asarray(self.stiffness - w**2 * self.mass + 1j * (loss + w * drag))


def _full(A: Real) -> Real:
    return np.diag(A) if A.ndim == 1 else A


def _times(A: Real, y: Complex) -> Complex:
    """A @ y[f] of a real matrix in real arithmetic."""
    return np.asarray((A @ np.ascontiguousarray(y).view(np.float64)).view(np.complex128))
