"""A body in its free modes, and its flexibility in some shapes: combinations of these modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["BodyModes", "ShapeFlexibility"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A sum over complex modes is checked at about so many frequencies, and holds where it inverts the stiffness this well:
# rounding times the condition of a sharp resonance.
_CHECKED, _INVERTED = 12, 1e-8
# A damping matrix resists a motion by more than this share of its largest eigenvalue, or by rounding alone.
_RESISTS = 1e-12


@dataclass(frozen=True, eq=False)
class ShapeFlexibility:
    """Flexibility of a body in some shapes at frequencies: left diag(weights) right.

    Parameters
    ----------
    weights : (f, p) complex128
    left, right : (k, p), (p, k) complex128
    """

    weights: Complex
    left: Complex
    right: Complex

    @classmethod
    def of(cls, matrices: Complex) -> ShapeFlexibility:
        """Of any matrices (f, k, k), each entry a term of the sum."""
        k = matrices.shape[1]
        one = np.eye(k, dtype=np.complex128)
        return cls(matrices.reshape(-1, k * k), np.repeat(one, k, axis=1), np.tile(one, (k, 1)))

    @property
    def matrices(self) -> Complex:
        """At every frequency (f, k, k)."""
        one = np.eye(len(self.left))
        return self.between(one, one)

    def at(self, some: slice) -> ShapeFlexibility:
        """At some of the frequencies."""
        return ShapeFlexibility(self.weights[some], self.left, self.right)

    def between(self, L: Array, R: Array) -> Complex:
        """L Y R^T at every frequency (f, l, r), for rows (l, k) and (r, k)."""
        f, p = self.weights.shape
        table = (L @ self.left)[:, None, :] * (R @ self.right.T)
        # All numbers are stated, because a body may have no shape.
        return np.asarray(self.weights @ table.reshape(len(L) * len(R), p).T).reshape(f, len(L), len(R))

    def amplitudes(self, R: Array, forces: Complex) -> Complex:
        """Y R^T forces at every frequency (f, k, p), for rows (r, k) and forces (f, r, p)."""
        f, r, p = forces.shape
        terms = self.weights.shape[1]
        each = (forces.transpose(0, 2, 1).reshape(f * p, r) @ (R @ self.right.T)).reshape(f, p, terms)
        found = (each * self.weights[:, None, :]).reshape(f * p, terms) @ self.left.T
        return np.asarray(found).reshape(f, p, len(self.left)).transpose(0, 2, 1)


@dataclass(frozen=True, eq=False)
class BodyModes:
    """A body in its free modes: Z(w) = K (1 + i loss) + i w D - w^2, with K = diag(omega^2) and a mass of one.

    Parameters
    ----------
    omega : (n,) float64
        Elastic frequencies in rad/s.
    D : (n,) or (n, n) float64
        Viscous damping: its diagonal, or a symmetric matrix.
    loss : float
        Loss factor of structural damping.
    """

    omega: Array
    D: Array
    loss: float = 0.0

    @property
    def count(self) -> int:
        """Number of elastic modes, n."""
        return self.omega.size

    def damped(self, X: Array | Complex) -> Array | Complex:
        """D X."""
        return self.D[:, None] * X if self.D.ndim == 1 else self.D @ X

    def dynamic_stiffness(self, V: Array, omega: Array) -> Complex:
        """V^T Z V at frequencies (f, k, k)."""
        weighted, w = self.omega[:, None] * V, omega[:, None, None]
        return np.asarray(
            (1 + 1j * self.loss) * (weighted.T @ weighted) + 1j * w * (V.T @ self.damped(V)) - w**2 * (V.T @ V)
        )

    def _inverted(self, V: Array, omega: Array) -> Complex:
        return np.asarray(np.linalg.inv(self.dynamic_stiffness(V, omega)))

    def flexibility(self, V: Array, omega: Array) -> ShapeFlexibility:
        """(V^T Z V)^-1 at frequencies (f,), as a sum over the complex modes of the shapes.

        Notes
        -----
        The modes of s^2 M + s D + K in the shapes come from one eigenproblem of twice their number; then all
        frequencies are one product. Where modes coincide without being independent, each frequency is inverted.
        """
        weighted, k = self.omega[:, None] * V, V.shape[1]
        M, D, K = V.T @ V, V.T @ self.damped(V), (1 + 1j * self.loss) * (weighted.T @ weighted)
        X = np.linalg.inv(M)
        first = np.block([[np.zeros((k, k)), np.eye(k)], [-X @ K, -X @ D]])
        s, shapes = np.linalg.eig(first)
        try:
            loads = np.linalg.solve(shapes, np.vstack([np.zeros((k, k)), X]).astype(np.complex128))
        except np.linalg.LinAlgError:
            return ShapeFlexibility.of(self._inverted(V, omega))
        found = ShapeFlexibility(1 / (1j * omega[:, None] - s), shapes[:k], loads)
        some = slice(None, None, max(1, omega.size // _CHECKED))
        off = self.dynamic_stiffness(V, omega[some]) @ found.at(some).matrices - np.eye(k)
        if abs(off).max(initial=0.0) < _INVERTED:
            return found
        return ShapeFlexibility.of(self._inverted(V, omega))

    def modal_stiffness(self, omega: Array) -> Complex:
        """Diagonal of Z at frequencies (f, n)."""
        viscous = self.D if self.D.ndim == 1 else self.D.diagonal()
        w = omega[:, None]
        return np.asarray(self.omega**2 * (1 + 1j * self.loss) + 1j * w * viscous - w**2)

    def in_all_modes(self, omega: Array) -> ShapeFlexibility:
        """Z^-1 at frequencies (f,)."""
        one = np.eye(self.count)
        if self.D.ndim == 2:
            return self.flexibility(one, omega)
        unit = one.astype(np.complex128)
        return ShapeFlexibility(1 / self.modal_stiffness(omega), unit, unit)

    def dual_norms(self, omega: Array, F: Complex) -> Array:
        """F^H (loss K + w D)^-1 F of loads (f, n, p), or more; infinite along motions without damping."""
        viscous = self.D if self.D.ndim == 1 else np.zeros(self.count)
        if self.D.ndim == 2 and not self.loss:
            # The matrix of a few dampers resists as many motions.
            viscous, V = np.linalg.eigh(self.D)
            viscous = np.where(viscous > _RESISTS * viscous.max(initial=0.0), viscous, 0.0)
            F = V.T @ F
        drag = (self.loss * self.omega**2 + omega[:, None] * viscous)[:, :, None]
        squares = abs(F) ** 2
        return np.asarray(
            np.sum(np.divide(squares, drag, out=np.where(squares > 0, np.inf, 0.0), where=drag > 0), axis=1)
        )
