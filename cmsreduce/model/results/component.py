"""A sparse factorisation that was done, in figures.

How much of the inertia that a hinge feels the modes of a model carry.

Modes that set an integrator's step and do not serve the band.

What rounding the numbers of a reduced body to single precision does to it.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "AxisCompleteness",
    "CostlyMode",
    "CostlyModes",
    "Factorisation",
    "MISSING_INERTIA",
    "RoundingEffect",
]


@dataclass(frozen=True)
class Factorisation:
    """A sparse factorisation that a stage did.

    Parameters
    ----------
    backend : str
        Solver that did it.
    rows, entries : int
        Rows of the matrix, entries of a triangular factor.
    gflop, mib : float
        Operations in 1e9 and memory in MiB, from the symbolic phase.
    seconds : float
        Wall time of both phases.
    precision : str
        ``double``, or ``single`` where the factor is in float32 and its solutions are refined.
    """

    backend: str
    rows: int
    entries: int
    gflop: float
    mib: float
    seconds: float
    precision: str = "double"


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


@dataclass(frozen=True)
class CostlyMode:
    """One of them.

    Parameters
    ----------
    mode : int
        Column of the body's shapes, from 0.
    hz : float
        Its frequency.
    kind : str
        Kind of basis shape with most of its kinetic energy.
    share : float
        What its mass changes of the flexibility in the band, of the static flexibility of the point and direction where
        that is most.
    """

    mode: int
    hz: float
    kind: str
    share: float


@dataclass(frozen=True)
class CostlyModes:
    """The modes of a body above all that serve the band.

    Parameters
    ----------
    modes : tuple of CostlyMode
        By frequency.
    serving_hz : float
        Highest frequency of the others; the upper end of the band if there are none.
    factor, share : float
        A mode serves the band if its frequency is below ``factor`` times the upper end of the band, or its share above
        ``share``.
    """

    modes: tuple[CostlyMode, ...]
    serving_hz: float
    factor: float
    share: float

    @property
    def gain(self) -> float:
        """How many times longer the step may be where they are treated statically."""
        return self.modes[-1].hz / self.serving_hz if self.modes else 1.0


# What the limits of a run usually allow a frequency.
_FREQUENCY = 1e-3
# A false spring that moves the lowest elastic frequency by 5e-5.
_RIGID = 1e-2


@dataclass(frozen=True)
class RoundingEffect:
    """Largest changes of a body in two forms; zero where there is nothing to change.

    Parameters
    ----------
    free : float
        Relative, of the natural frequencies, modal mass and stiffness rounded.
    held : float
        Relative, of those with every interface held, the shapes at the interfaces rounded, too: what joints lead to.
        Infinite if a frequency is lost.
    rigid_hz : float
        Frequency that a rigid motion gets where neighbours move all interfaces as one.
    boundary_free : float
        Relative, of the natural frequencies, mass and stiffness rounded in interface dofs and modes with them held: a
        superelement. 0 for a body that cannot be one.
    boundary_rigid_hz : float
        Frequency that a rigid motion gets in that form.
    lowest_hz : float
        Lowest elastic frequency, by which to judge the rigid motions.
    """

    free: float = 0.0
    held: float = 0.0
    rigid_hz: float = 0.0
    boundary_free: float = 0.0
    boundary_rigid_hz: float = 0.0
    lowest_hz: float = 0.0

    @property
    def modal_matters(self) -> bool:
        """Whether the modal form loses what an engineer would see."""
        return max(self.free, self.held) > _FREQUENCY or self.rigid_hz > _RIGID * self.lowest_hz

    @property
    def boundary_matters(self) -> bool:
        """Whether the form of interface dofs does."""
        return self.boundary_free > _FREQUENCY or self.boundary_rigid_hz > _RIGID * self.lowest_hz
