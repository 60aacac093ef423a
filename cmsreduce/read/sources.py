"""Where the matrices and interfaces of a body are to be found: what a user asks for, not yet read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["InterfaceSpec", "MatrixSource"]


@dataclass(frozen=True)
class MatrixSource:
    """A matrix in a file.

    Parameters
    ----------
    path : Path
        The file.
    matrix : str, optional
        Name of the matrix in it; needed where the file holds several.
    format : str, optional
        Format, found by content if absent.
    """

    path: Path
    matrix: str | None = None
    format: str | None = None


@dataclass(frozen=True, eq=False)
class InterfaceSpec:
    """An interface as the user names it: by nodes, or by a dof set.

    Parameters
    ----------
    nodes : tuple of int, optional
        Node ids in order.
    dofs : str or tuple of int, optional
        Components 1..6 that every node must have; by default all of 123456 that a node has.
    set : str, optional
        Dof set of the source instead of nodes, such as ``b``.
    frame : (3, 3) float64, optional
        Axes as rows, in basic; by default the displacement frame of the first node.
    """

    nodes: tuple[int, ...] | None = None
    dofs: str | tuple[int, ...] | None = None
    set: str | None = None
    frame: NDArray[np.float64] | None = None
