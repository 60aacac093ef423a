"""Bodies as they enter an assembly, and the assembled system.

The elastic modes of a body between the inputs and the outputs that a scene gives it.

A controller in state space.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.body import Interface
from cmsreduce.model.scene import Configuration, Joint

__all__ = [
    "Controller",
    "Matrix",
    "ModalChannels",
    "Substructure",
    "System",
]

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


@dataclass(frozen=True, eq=False)
class ModalChannels:
    """q'' + 2 zeta w q' + w^2 q = B u, y = C1 q + C2 q': elastic modes only (theory sections 3 and 4).

    Parameters
    ----------
    body : str
        Name of the body, for messages.
    omega, zeta : (e,) float64
        Elastic frequencies in rad/s, positive, and damping ratios.
    B : (e, inputs) float64
        Modal input matrix: interface forces and actuators.
    C1, C2 : (outputs, e) float64
        Modal displacement and rate output matrices: sensors and interface motions. They need not have the same rows.

    Raises
    ------
    MatrixError
        If the shapes do not agree, or a frequency is zero or infinite: rigid and static modes are none of these.
    """

    body: str
    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    B: NDArray[np.float64]
    C1: NDArray[np.float64]
    C2: NDArray[np.float64]

    def __post_init__(self) -> None:
        e = self.omega.size
        if self.zeta.shape != (e,) or {self.B.shape[0], self.C1.shape[1], self.C2.shape[1]} != {e}:
            raise MatrixError(
                f"body '{self.body}': {e} modes need as many damping ratios, rows of B {self.B.shape} and columns of "
                f"C1 {self.C1.shape} and C2 {self.C2.shape}"
            )
        if not (np.isfinite(self.omega) & (self.omega > 0)).all():
            raise MatrixError(
                f"body '{self.body}': a rigid or static mode, with frequency zero or infinite, cannot be ranked; it is "
                "always kept"
            )

    @property
    def count(self) -> int:
        """Number of modes."""
        return int(self.omega.size)

    def only(self, modes: ArrayLike) -> ModalChannels:
        """The same inputs and outputs with some of the modes."""
        k = np.asarray(modes, dtype=np.int64)
        return ModalChannels(self.body, self.omega[k], self.zeta[k], self.B[k], self.C1[:, k], self.C2[:, k])


@dataclass(frozen=True, eq=False)
class Controller:
    """x' = A x + B y, v = C x + D y: from the sensors' signals y to efforts v, which act as u = -v.

    Parameters
    ----------
    A, B, C, D : (n, n), (n, sensors), (actuators, n), (actuators, sensors) float64
        In the order of the scene's sensors, motion by motion, and of its actuators; n may be 0.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]

    @property
    def states(self) -> int:
        """Number of states n."""
        return int(self.A.shape[0])
