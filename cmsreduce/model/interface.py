"""Where a body is joined to others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Interface"]


@dataclass(frozen=True, eq=False)
class Interface:
    """Named dofs of a body to which joints attach (the i-set, or a part of it).

    Parameters
    ----------
    name : str
        Name of the interface, unique in its body.
    node : (p,) int64
        Node ids in order; joints pair them one by one.
    components : tuple of (tuple of int)
        Components 1..6 of each node, along its displacement frame, that belong to the interface.
    position : (p, 3) float64
        Coordinates of the nodes in the body's basic frame, in the body's unit of length.
    frame : (3, 3) float64
        Axes of the interface as rows, in basic components: a joint on it has these axes.
    node_axes : (p, 3, 3) float64, optional
        Displacement frames of the nodes as rows, in basic components; ``frame`` for every node if absent.
    """

    name: str
    node: NDArray[np.int64]
    components: tuple[tuple[int, ...], ...]
    position: NDArray[np.float64]
    frame: NDArray[np.float64]
    node_axes: NDArray[np.float64] | None = None

    def node_frame(self, k: int) -> NDArray[np.float64]:
        """Displacement axes of node k, which its components refer to (3, 3)."""
        return self.frame if self.node_axes is None else np.asarray(self.node_axes[k])
