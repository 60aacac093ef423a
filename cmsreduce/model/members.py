"""Straight bars and beams of a body, as far as the force along them matters.

Elastic members of a deck: bars, rods and springs, with all that their stiffness depends on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Bars",
    "Members",
]


@dataclass(frozen=True, eq=False)
class Bars:
    """Bars between two nodes each.

    Parameters
    ----------
    id : (b,) int64
        Element ids.
    node : (b, 2) int64
        Their ends.
    EA : (b,) float64
        Axial stiffness, in units of force.
    radius_squared : (b,) float64
        Polar moment of the section over its area, Ip / A, in units of length squared; 0 where it does not matter.
    bends : (b,) bool
        Whether the bar is a beam, whose ends have slopes, or a rod.
    hinged : (b, 2) bool, optional
        Whether each end of a beam is free to turn across it; none by default.
    offset : (b, 2, 3) float64, optional
        From each node to the end of the bar, along the node's displacement axes; zero by default.
    """

    id: NDArray[np.int64]
    node: NDArray[np.int64]
    EA: NDArray[np.float64]
    radius_squared: NDArray[np.float64]
    bends: NDArray[np.bool_]
    hinged: NDArray[np.bool_] | None = None
    offset: NDArray[np.float64] | None = None

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Whether each end of each bar has a slope that its node gives (b, 2)."""
        both = np.repeat(self.bends[:, None], 2, axis=1)
        return both if self.hinged is None else both & ~self.hinged

    @property
    def on_arms(self) -> NDArray[np.bool_]:
        """Whether each end of each bar is offset from its node (b, 2)."""
        return np.zeros((len(self), 2), dtype=bool) if self.offset is None else np.asarray(self.offset.any(axis=2))

    def __len__(self) -> int:
        return int(self.id.size)


@dataclass(frozen=True, eq=False)
class Members:
    """Straight bars and rods between two nodes each, and springs between two dofs.

    Parameters
    ----------
    node : (b, 2) int64
        Ends of the bars.
    offset : (b, 2, 3) float64
        From each node to the bar's end, along the basic axes.
    up : (b, 3) float64
        Vector in the bar's first plane of bending, basic axes; not along the bar. Any for a rod.
    EA, GJ : (b,) float64
        Axial and torsional stiffness, in units of force and of force times area.
    EI : (b, 2, 2) float64
        Stiffness of bending in the two planes, and between them; zero for rods.
    shear : (b, 2) float64
        One over the shear stiffness in each plane, 1 / (k G A); zero where the bar does not shear.
    released : (b, 12) bool
        Motions of the ends that the bar is free in, along its own axes, end by end.
    spring : (s,) float64
        Stiffness of the springs.
    between : (s, 2, 2) int64
        Node and component of the two dofs that each joins; node 0 is the ground.
    """

    node: NDArray[np.int64]
    offset: NDArray[np.float64]
    up: NDArray[np.float64]
    EA: NDArray[np.float64]
    GJ: NDArray[np.float64]
    EI: NDArray[np.float64]
    shear: NDArray[np.float64]
    released: NDArray[np.bool_]
    spring: NDArray[np.float64]
    between: NDArray[np.int64]
