"""Integrals of a body's mass and shapes, as multibody codes take them (theory section 8).

The frame that a floating-frame code carries a body's rigid motion with, and what of it was left in the modes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FloatingFrame",
    "FrameCondition",
    "FrameKind",
    "IntegralFrame",
    "LUMPINGS",
    "Lumping",
    "ModalIntegrals",
]

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


FrameKind = Literal["clamped", "mean-axis", "chord"]
"""What the deforming modes do not do: move or turn an interface; have momentum; leave a line between two interfaces."""


@dataclass(frozen=True)
class FrameCondition:
    """Which motion of the body is the frame's.

    Parameters
    ----------
    kind : FrameKind
        ``clamped``: that of an interface. ``mean-axis``: that of the momentum (Buckens). ``chord``: that of the line
        from one interface to another, turned about itself as ``roll`` says.
    at : str
        Interface that the frame is clamped at, or that the chord starts from; empty for mean axes.
    to : str
        Interface that the chord ends at.
    roll : str
        ``INTERFACE.DOF`` or ``NODE.DOF``, along the basic axes, that does not move in the frame: what holds the chord
        against turning about itself. Empty for the rotation of ``at`` about the chord.
    """

    kind: FrameKind
    at: str = ""
    to: str = ""
    roll: str = ""

    def __str__(self) -> str:
        """In words: ``clamped at root``."""
        if self.kind == "clamped":
            return f"clamped at {self.at}"
        if self.kind == "chord":
            return f"chord from {self.at} to {self.to}"
        return "mean axes"


@dataclass(frozen=True, eq=False)
class FloatingFrame:
    """A frame found for a body, and the rigid motion that its deforming modes lose to it.

    Parameters
    ----------
    condition : FrameCondition
        What makes it the frame.
    origin : (3,) float64
        Where it stands in the body at rest, in basic.
    axes : (3, 3) float64
        Its axes as rows, in basic.
    removed : (6, e) float64
        Amounts of the six rigid modes taken off each of the e deforming ones.
    node, component : (p,) int64
        Dofs that the condition is on; none for mean axes, which all of the mass decides.
    residual : float
        Largest amount of a rigid mode that is left in a deforming one, relative to the largest taken off, or to 1.
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
        """T (m, m): the modes seen from the frame are Phi T, rigid ones as they were.

        Mass T^T M T is no longer the identity: the rigid modes couple with the others by -removed, and those have
        1 + removed^T removed. Stiffness is the same.
        """
        r, e = self.removed.shape
        T = np.eye(r + e)
        T[:r, r:] = -self.removed
        return T


@dataclass(frozen=True, eq=False)
class IntegralFrame:
    """Where the integrals of a body are taken about, along which axes, and over which mass.

    Parameters
    ----------
    about : str
        In words, such as ``interface root``.
    origin : (3,) float64
        In basic.
    axes : (3, 3) float64
        As rows, in basic.
    lumping : Lumping
        Mass that is integrated over.
    """

    about: str
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    lumping: Lumping = "consistent"

    @classmethod
    def basic(cls, lumping: Lumping = "consistent") -> IntegralFrame:
        """The body's basic frame."""
        return cls("origin of the body's basic frame", np.zeros(3), np.eye(3), lumping)
