"""Integrals of a body's mass and shapes for multibody codes, and floating frames (theory section 8)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError

__all__ = [
    "FloatingFrame",
    "FrameCondition",
    "FrameKind",
    "IntegralFrame",
    "LUMPINGS",
    "Lumping",
    "ModalIntegrals",
    "SecondOrder",
    "UNDETERMINED",
]

UNDETERMINED = (
    "int r_i phi_j dm and int phi_i phi_j dm are not determined: mass moves with generalised coordinates, whose shapes "
    "over the body are not in its files"
)
"""Reason why a body lacks the integrals of second order."""

Lumping = Literal["consistent", "row-sum", "diagonal"]
"""Mass matrix of the integrals: M itself, M lumped by row sums, or its diagonal scaled to the body's mass."""

LUMPINGS: tuple[Lumping, ...] = get_args(Lumping)

FrameKind = Literal["clamped", "mean-axis", "chord"]
"""Relative to the frame, deforming modes do not move an interface, a line between two, or have no momentum."""


@dataclass(frozen=True, eq=False)
class SecondOrder:
    """Integrals that need the shapes all over the body; momenta and modal mass do not determine them.

    Parameters
    ----------
    r_phi : (3, 3, k) float64
        int r_i phi_j dm, with the rotational inertia of the nodes; its skew part is int r x phi dm.
    phi_phi : (3, 3, k, k) float64
        int phi_i phi_j dm: entry [i, j, a, b] belongs to component i of mode a and component j of mode b. With the
        rotational inertia of the nodes; its trace over i = j is the modal mass.
    """

    r_phi: NDArray[np.float64]
    phi_phi: NDArray[np.float64]

    def of(self, T: NDArray[np.float64]) -> SecondOrder:
        """Integrals of the shapes T (k, m) in amplitudes of these."""
        return SecondOrder(self.r_phi @ T, T.T @ self.phi_phi @ T)

    def seen_from(
        self, origin: NDArray[np.float64], axes: NDArray[np.float64], phi: NDArray[np.float64]
    ) -> SecondOrder:
        """The same integrals about another origin (3,) and along other axes, as rows (3, 3).

        Both are in the frame of these integrals, and ``phi`` is int phi dm in it (3, k).
        """
        r_phi = self.r_phi - origin[:, None, None] * phi
        turned = [np.einsum("ai,bj,ij...->ab...", axes, axes, each) for each in (r_phi, self.phi_phi)]
        return SecondOrder(*turned)


@dataclass(frozen=True, eq=False)
class ModalIntegrals:
    """Integrals over a body at rest, in a frame of the body.

    Parameters
    ----------
    origin : (3,) float64
        Origin of the frame in the body's basic frame.
    axes : (3, 3) float64
        Axes of the frame as rows, in the basic frame; the vectors and tensors below are along these axes.
    lumping : Lumping
        Mass matrix of the integrals.
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
    modes : (k,) int64
        Columns of the component's shapes: its elastic and static modes.
    second_order : SecondOrder, optional
        None if the files of the body do not determine them.
    """

    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    lumping: Lumping
    mass: float
    first_moment: NDArray[np.float64]
    inertia: NDArray[np.float64]
    phi: NDArray[np.float64]
    r_cross_phi: NDArray[np.float64]
    modes: NDArray[np.int64]
    second_order: SecondOrder | None

    @property
    def r_phi(self) -> NDArray[np.float64]:
        """Int r_i phi_j dm (3, 3, k)."""
        return self._determined.r_phi

    @property
    def phi_phi(self) -> NDArray[np.float64]:
        """Int phi_i phi_j dm (3, 3, k, k)."""
        return self._determined.phi_phi

    @property
    def _determined(self) -> SecondOrder:
        if self.second_order is None:
            raise DofMapError(f"{UNDETERMINED}; no integral of second order can be used")
        return self.second_order

    @property
    def centre_of_mass(self) -> NDArray[np.float64]:
        """Centre of mass (3,) in the frame."""
        return self.first_moment / self.mass

    @property
    def second_moment(self) -> NDArray[np.float64]:
        """Int r r^T dm (3, 3) about the origin."""
        return np.asarray(np.trace(self.inertia) / 2 * np.eye(3) - self.inertia)


@dataclass(frozen=True)
class FrameCondition:
    """Condition that makes a floating frame.

    Parameters
    ----------
    kind : FrameKind
        ``clamped``: the frame moves with an interface. ``mean-axis``: with the momentum (Buckens). ``chord``: with the
        line from one interface to another; ``roll`` decides its rotation about itself.
    at : str
        Interface of a clamped frame, or start of the chord; empty for mean axes.
    to : str
        Interface at the end of the chord.
    roll : str
        ``INTERFACE.DOF`` or ``NODE.DOF``, along the basic axes, that does not move in the frame. Empty for the rotation
        of ``at`` about the chord.
    """

    kind: FrameKind
    at: str = ""
    to: str = ""
    roll: str = ""

    def __str__(self) -> str:
        """Condition in words: ``clamped at root``."""
        if self.kind == "clamped":
            return f"clamped at {self.at}"
        if self.kind == "chord":
            return f"chord from {self.at} to {self.to}"
        return "mean axes"


@dataclass(frozen=True, eq=False)
class FloatingFrame:
    """A floating frame of a body, and the rigid motion that it takes off the deforming modes.

    Parameters
    ----------
    condition : FrameCondition
        Condition that makes the frame.
    origin : (3,) float64
        Origin in the body at rest, in basic.
    axes : (3, 3) float64
        Axes as rows, in basic.
    removed : (6, e) float64
        Amounts of the six rigid modes taken off each of the e deforming modes.
    node, component : (p,) int64
        Dofs of the condition; none for mean axes, which depend on the whole mass.
    residual : float
        Largest amount of a rigid mode left in a deforming mode, relative to the largest one taken off, or to 1.
    """

    condition: FrameCondition
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    removed: NDArray[np.float64]
    node: NDArray[np.int64]
    component: NDArray[np.int64]
    residual: float

    @property
    def change(self) -> NDArray[np.float64]:
        """T (m, m): the modes relative to the frame are Phi T; rigid modes stay as they are.

        The mass T^T M T is not the identity: rigid and other modes couple by -removed, and the block of the other
        modes is 1 + removed^T removed. The stiffness stays the same.
        """
        r, e = self.removed.shape
        T = np.eye(r + e)
        T[:r, r:] = -self.removed
        return T


@dataclass(frozen=True, eq=False)
class IntegralFrame:
    """Reference point, axes and mass matrix of the integrals of a body.

    Parameters
    ----------
    about : str
        Reference point in words, such as ``interface root``.
    origin : (3,) float64
        Reference point in basic.
    axes : (3, 3) float64
        Axes as rows, in basic.
    lumping : Lumping
        Mass matrix of the integrals.
    """

    about: str
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    lumping: Lumping = "consistent"

    @classmethod
    def basic(cls, lumping: Lumping = "consistent") -> IntegralFrame:
        """The body's basic frame."""
        return cls("origin of the body's basic frame", np.zeros(3), np.eye(3), lumping)
