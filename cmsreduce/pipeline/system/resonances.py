"""Modes of an assembled system, undamped and damped, with shapes in the coordinates of each body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.eigen import ComplexModes
from cmsreduce.model import Matrix, System

__all__ = ["DampedModes", "Number", "Resonances", "by_body", "damped_modes_of", "modal_weights"]

Number = TypeVar("Number", np.float64, np.complex128)


@dataclass(frozen=True, eq=False)
class Resonances:
    """Elastic modes of a system.

    Parameters
    ----------
    omega, zeta : (k,) float64
        Natural frequencies in rad/s and damping ratios (diagonal of the damping in these modes).
    shapes : mapping of body to (m_i, k) float64
        Shapes in each body's own coordinates.
    """

    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    shapes: Mapping[str, NDArray[np.float64]]

    def inside(self, band: tuple[float, float]) -> int:
        """Number of modes in a band in Hz, its ends included."""
        low, high = (2 * np.pi * edge for edge in band)
        return int(np.count_nonzero((self.omega >= low) & (self.omega <= high)))


@dataclass(frozen=True, eq=False)
class DampedModes:
    """Complex modes of a system without its overdamped motions.

    Parameters
    ----------
    s : (k,) complex128
        Roots in rad/s.
    shapes : mapping of body to (m_i, k) complex128
        Shapes in each body's own coordinates, of unit length in the system's mass.
    peaks : (k, outputs, inputs) float64
        Response of each mode with its conjugate at its natural frequency.
    """

    s: NDArray[np.complex128]
    shapes: Mapping[str, NDArray[np.complex128]]
    peaks: NDArray[np.float64]


def by_body(system: System, X: NDArray[Number]) -> dict[str, NDArray[Number]]:
    """Shapes of a system in the coordinates of each body."""
    ends = np.cumsum(list(system.sizes.values()))
    return dict(zip(system.sizes, np.split(np.asarray(system.T @ X), ends[:-1]), strict=True))


def damped_modes_of(system: System, modes: ComplexModes) -> DampedModes:
    """Complex modes of a system with their peaks and their shapes in the bodies.

    The residue of a root s is x y^T / (y^T (2 s M + D) x), y the left shape. The two residues of a nearly critical pair
    are large and cancel.
    """
    s, X, Y, w = modes.s, modes.X, modes.Y, modes.omega
    slope = 2 * s * (Y * np.asarray(system.M @ X)).sum(axis=0)
    if system.D is not None:
        slope = slope + (Y * np.asarray(system.D @ X)).sum(axis=0)
    outputs, inputs = system.C1 @ X + 1j * w * (system.C2 @ X), (Y.T @ system.B) / slope[:, None]
    mirrored = (system.C1 @ X).conj() + 1j * w * (system.C2 @ X).conj()
    # A mode without damping, as of a body without modes on a spring, has no bound where a channel shows it.
    with np.errstate(divide="ignore", invalid="ignore"):
        own, other = (
            np.einsum("yk,ku->kyu", left, right) / (1j * w - root)[:, None, None]
            for left, right, root in ((outputs, inputs, s), (mirrored, inputs.conj(), s.conj()))
        )
        peaks = abs(own + other)
    return DampedModes(s, by_body(system, X), np.nan_to_num(peaks, nan=0.0, posinf=np.inf))


def modal_weights(A: Matrix, Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Diagonal of Phi^T A Phi (k,)."""
    return np.asarray(np.einsum("ij,ij->j", Phi, A @ Phi))
