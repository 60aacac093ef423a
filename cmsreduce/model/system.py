"""Bodies as they enter an assembly, and the assembled system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model.interface import Interface
from cmsreduce.model.scene import Configuration, Joint

__all__ = ["Matrix", "Substructure", "System"]

Matrix = NDArray[np.float64] | sp.csc_array
"""A dense array or a sparse one, whichever the body is held in."""


@dataclass(frozen=True, eq=False)
class Substructure:
    """A body in the coordinates it is assembled in: physical dofs, modes, or six rigid motions.

    Parameters
    ----------
    name : str
        Name of the body.
    M, K : (m, m) Matrix
        Mass and stiffness.
    D : (m, m) Matrix, optional
        Viscous damping.
    loss : (m, m) Matrix, optional
        Imaginary part of a complex stiffness.
    rigid : (m, r) float64
        Coordinates of the rigid-body modes: K, D and loss vanish on them.
    motion : mapping of point label to (6, m) Matrix
        Motion x y z rx ry rz of each named point along the body's basic axes; rows a point does not have are zero.
    has : mapping of point label to (6,) bool
        Which motions along the point's displacement axes the point has.
    axes : mapping of point label to (3, 3) float64
        Displacement axes of the point as rows, in basic.
    position : mapping of point label to (3,) float64
        Coordinates of the point in the body's basic frame.
    interfaces : mapping of name to Interface
        Interfaces; the label of node k of an interface is ``point_labels(interface)[k]``.
    omega : (m,) float64, optional
        Natural frequencies where the coordinates are orthonormal modes (M = I, K = diag(omega^2)); infinite for static
        ones, which have no mass and unit stiffness.
    rounding : float
        Relative rounding of the entries of M and K, where they come from a file.
    """

    name: str
    M: Matrix
    K: Matrix
    D: Matrix | None
    loss: Matrix | None
    rigid: NDArray[np.float64]
    motion: Mapping[str, Matrix]
    has: Mapping[str, NDArray[np.bool_]]
    axes: Mapping[str, NDArray[np.float64]]
    position: Mapping[str, NDArray[np.float64]]
    interfaces: Mapping[str, Interface] = field(default_factory=dict)
    omega: NDArray[np.float64] | None = None
    rounding: float = 2.0**-53

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def point_labels(self, interface: Interface) -> list[str]:
        """Labels, in ``motion``, of the nodes of an interface."""
        return [interface.name if node < 0 else str(node) for node in interface.node]


@dataclass(frozen=True, eq=False)
class System:
    """Bodies joined in one configuration: M x'' + D x' + (K + i loss) x = B u, y = C1 x + C2 x'.

    Parameters
    ----------
    configuration : Configuration
        Setting of the joints.
    T : (sum m_i, N) Matrix
        Null space of the joint constraints: body coordinates stacked in order = T x.
    M, K : (N, N) Matrix
        Mass and stiffness.
    D, loss : (N, N) Matrix, optional
        Viscous damping, imaginary part of the stiffness.
    B : (N, inputs) float64
        Inputs.
    C1, C2 : (outputs, N) float64
        Displacement and rate outputs.
    rigid : (N, R) float64
        Rigid-body motions of the system and free motions of its joints, orthonormal in M; K vanishes on them.
    sizes : mapping of body to int
        Coordinates of each body in the stack; the bodies that joints own, of their springs, dampers and inertias,
        come last.
    inputs, outputs : tuple of str
        Names of the channels.
    rounding : float
        Relative rounding of the entries of M and K, where they come from a file.
    joints : tuple of Joint
        What joins the bodies.
    notes : tuple of str
        What was done in assembly that the user may not expect.
    """

    configuration: Configuration
    T: Matrix
    M: Matrix
    K: Matrix
    D: Matrix | None
    loss: Matrix | None
    B: NDArray[np.float64]
    C1: NDArray[np.float64]
    C2: NDArray[np.float64]
    rigid: NDArray[np.float64]
    sizes: Mapping[str, int]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rounding: float = 2.0**-53
    joints: tuple[Joint, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def N(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])
