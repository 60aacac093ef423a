"""The frame that a floating-frame code carries a body's rigid motion with, and what of it was left in the modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.modal_integrals import Lumping

__all__ = ["FloatingFrame", "FrameCondition", "FrameKind", "IntegralFrame"]

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
