"""Modes of an assembled system, undamped and damped, with shapes in the coordinates of each body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Matrix, System

__all__ = ["DampedModes", "Number", "Resonances", "by_body", "modal_weights"]

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
    """

    s: NDArray[np.complex128]
    shapes: Mapping[str, NDArray[np.complex128]]


def by_body(system: System, X: NDArray[Number]) -> dict[str, NDArray[Number]]:
    """Shapes of a system in the coordinates of each body."""
    ends = np.cumsum(list(system.sizes.values()))
    return dict(zip(system.sizes, np.split(np.asarray(system.T @ X), ends[:-1]), strict=True))


def modal_weights(A: Matrix, Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    """Diagonal of Phi^T A Phi (k,)."""
    return np.asarray(np.einsum("ij,ij->j", Phi, A @ Phi))
