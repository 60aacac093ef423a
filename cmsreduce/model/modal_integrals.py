"""Integrals of a body's mass and shapes, as multibody codes take them (theory section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = ["LUMPINGS", "Lumping", "ModalIntegrals"]

Lumping = Literal["consistent", "row-sum", "diagonal"]
"""Mass that is integrated over: M itself, M lumped by row sums, or by its diagonal scaled to the body's mass."""

LUMPINGS: tuple[Lumping, ...] = ("consistent", "row-sum", "diagonal")
"""Every kind of mass."""


@dataclass(frozen=True, eq=False)
class ModalIntegrals:
    """Integrals over a body at rest, in a frame of its own.

    Parameters
    ----------
    origin : (3,) float64
        Origin of the frame in the body's basic frame.
    axes : (3, 3) float64
        Axes of the frame as rows, in the basic frame; vectors and tensors below are along them.
    lumping : Lumping
        Mass that is integrated over.
    mass : float
        int dm.
    first_moment : (3,) float64
        int r dm, r from the origin.
    inertia : (3, 3) float64
        int (r.r 1 - r r^T) dm about the origin, with the rotational inertia of the nodes.
    phi : (3, k) float64
        int phi dm of each mode.
    r_cross_phi : (3, k) float64
        int r x phi dm, with the rotational inertia of the nodes.
    r_phi : (3, 3, k) float64
        int r_i phi_j dm, with the rotational inertia of the nodes: r_cross_phi is what is skew in it.
    phi_phi : (3, 3, k, k) float64
        int phi_i phi_j dm: entry [i, j, a, b] is of component i of mode a and component j of mode b. With the
        rotational inertia of the nodes: its trace over i = j is the modal mass.
    modes : (k,) int64
        Columns of the component's shapes that were integrated: its elastic and static modes.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    lumping: Lumping
    mass: float
    first_moment: NDArray[np.float64]
    inertia: NDArray[np.float64]
    phi: NDArray[np.float64]
    r_cross_phi: NDArray[np.float64]
    r_phi: NDArray[np.float64]
    phi_phi: NDArray[np.float64]
    modes: NDArray[np.int64]

    @property
    def centre_of_mass(self) -> NDArray[np.float64]:
        """Centre of mass (3,) in the frame."""
        return self.first_moment / self.mass

    @property
    def second_moment(self) -> NDArray[np.float64]:
        """Int r r^T dm (3, 3) about the origin."""
        return np.asarray(np.trace(self.inertia) / 2 * np.eye(3) - self.inertia)
