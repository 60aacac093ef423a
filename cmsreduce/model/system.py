"""The assembled system, the modes of a body with their inputs and outputs, and a controller."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.joint import Joint
from cmsreduce.model.scene import Configuration
from cmsreduce.model.substructure import Matrix

__all__ = [
    "Controller",
    "ModalChannels",
    "System",
    "damping_parts",
    "is_gyroscopic",
]

# Skew part of a damping matrix, relative to its largest entry, that congruent products leave: some hundred roundings.
_SKEW = 1e-12


@dataclass(frozen=True, eq=False)
class System:
    """Bodies joined in one configuration: M x'' + D x' + (K + i loss) x = B u, y = C1 x + C2 x'.

    Parameters
    ----------
    configuration : Configuration
        Name and angles.
    T : (sum m_i, N) Matrix
        Null space of the joint constraints: body coordinates stacked in order = T x.
    M, K : (N, N) Matrix
        Mass and stiffness.
    D, loss : (N, N) Matrix, optional
        Viscous damping with the gyroscopic forces as its skew part, imaginary part of the stiffness.
    B : (N, inputs) float64
        Inputs.
    C1, C2 : (outputs, N) float64
        Displacement and rate outputs.
    rigid : (N, R) float64
        Rigid-body motions of the system and free motions of its joints, orthonormal in M; K vanishes on them.
    sizes : mapping of body to int
        Number of coordinates of each body in the stack. The bodies of joints (springs, dampers and inertias) come
        last.
    inputs, outputs : tuple of str
        Names of the channels.
    rounding : float
        Relative rounding of the entries of M and K.
    joints : tuple of Joint
        Joints between the bodies.
    notes : tuple of str
        Remarks on the assembly for the user.
    scale : (sum m_i,) float64, optional
        Factors of the rows of T, so that the columns of T / scale are orthonormal; without it those of T are.
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
    scale: NDArray[np.float64] | None = None

    def __repr__(self) -> str:
        bodies = ", ".join(self.sizes)
        channels = f"{len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<System {self.configuration.name}: {bodies}; {self.N} dofs, {self.rigid.shape[1]} rigid, {channels}>"

    @property
    def N(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    @property
    def gyroscopic(self) -> bool:
        """True if its damping has a skew part."""
        return is_gyroscopic(self.D)


def is_gyroscopic(D: Matrix | None) -> bool:
    """True if a damping matrix has a skew part that is more than the rounding of products."""
    if D is None:
        return False
    entries, skew = (np.asarray(A.data if isinstance(A, sp.sparray) else A) for A in (D, D - D.T))
    return float(abs(skew).max(initial=0.0)) > _SKEW * float(abs(entries).max(initial=0.0))


def damping_parts(D: Matrix) -> tuple[Matrix, ...]:
    """A damping matrix alone, or its symmetric and its skew part if it has one: each has rounding of its own size."""
    if not is_gyroscopic(D):
        return (D,)
    parts: tuple[Any, ...] = (D + D.T) / 2, (D - D.T) / 2
    return tuple(part if isinstance(part, np.ndarray) else sp.csc_array(part) for part in parts)


@dataclass(frozen=True, eq=False)
class ModalChannels:
    """Elastic modes of a body: q'' + 2 zeta w q' + w^2 q = B u, y = C1 q + C2 q' (theory sections 3 and 4).

    Parameters
    ----------
    body : str
        Name of the body, for messages.
    omega, zeta : (e,) float64
        Elastic frequencies in rad/s, positive, and damping ratios.
    B : (e, inputs) float64
        Modal input matrix: interface forces and actuators.
    C1, C2 : (outputs, e) float64
        Modal displacement and rate output matrices: sensors and interface motions. Their rows may differ in number.
    structural : bool
        True if the damping is structural: 2 i zeta w^2 q in place of 2 zeta w q'. Bounds take it so; Gramians, which
        need a real state space, take the ratios.

    Raises
    ------
    MatrixError
        If the sizes disagree, or a frequency is zero or infinite, as of rigid and static modes.
    """

    body: str
    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    B: NDArray[np.float64]
    C1: NDArray[np.float64]
    C2: NDArray[np.float64]
    structural: bool = False

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
        """Some of the modes, with all inputs and outputs."""
        k = np.asarray(modes, dtype=np.int64)
        B, C1, C2 = self.B[k], self.C1[:, k], self.C2[:, k]
        return ModalChannels(self.body, self.omega[k], self.zeta[k], B, C1, C2, self.structural)


@dataclass(frozen=True, eq=False)
class Controller:
    """A controller x' = A x + B y, v = C x + D y: from the sensors' signals y to efforts v, which act as u = -v.

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
