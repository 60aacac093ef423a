"""What acts in a joint on one of its free motions."""

from __future__ import annotations

from dataclasses import dataclass

from cmsreduce.errors import SceneError

__all__ = ["JointElement"]

_FIRST_ROTATION = 3


@dataclass(frozen=True)
class JointElement:
    """Spring, damper and inertia of a joint along or about one of its free motions.

    The spring and the damper act on the motion of the second interface against the first. The inertia belongs to the
    joint, not to a body: it turns with the first interface, and no mass properties of a body contain it.

    Parameters
    ----------
    dof : int
        Motion 0..5 along the joint's axes.
    stiffness, damping : float
        In the scene's units: force a length, or moment a radian; the same times a second.
    inertia : float
        Moment of inertia about the joint's axis, of a rotation only.

    Raises
    ------
    SceneError
        If a figure is negative, or a translation is given an inertia.
    """

    dof: int
    stiffness: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0

    def __post_init__(self) -> None:
        for what in ("stiffness", "damping", "inertia"):
            if not getattr(self, what) >= 0:
                raise SceneError(f"a joint's {what} of {getattr(self, what):g} is negative")
        if self.inertia and self.dof < _FIRST_ROTATION:
            raise SceneError(
                "a joint's inertia turns about one of its axes; what slides along an axis has mass in every direction: "
                "give it to a body"
            )
