"""How much of the inertia that a hinge feels the modes of a model carry."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["MISSING_INERTIA", "AxisCompleteness"]

MISSING_INERTIA = 0.05
"""Share of a hinge's inertia that may stay rigid with the modes left out: a motor feels a load that much too heavy."""


@dataclass(frozen=True)
class AxisCompleteness:
    """Completeness of the modes for one articulation axis in one configuration.

    Parameters
    ----------
    axis : str
        JOINT.DOF.
    configuration : str
        Setting of the joints.
    band : float
        Share of the inertia at the hinge that the modes in the band leave rigid: 1 without any mode.
    kept : float
        What all modes of the reduced model leave.
    whole : float
        What all modes of the mode sets leave: the inertia of the hinge nodes themselves, and what the cutoff left out.
    locked : float
        Share of the inertia at the hinge that all modes of the reduced model hold with every hinge locked: 0 without
        any mode; NaN if it was not measured.
    """

    axis: str
    configuration: str
    band: float
    kept: float
    whole: float
    locked: float = float("nan")

    @property
    def missing(self) -> float:
        """Share of the hinge's inertia that is lost with the modes left out."""
        return self.kept - self.whole

    @property
    def poor(self) -> bool:
        """Whether that is more than `MISSING_INERTIA`."""
        return self.missing > MISSING_INERTIA
