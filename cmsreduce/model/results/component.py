"""Findings about one body: modes kept, solver work, effective mass, inertia at hinges, costly modes, precision."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.body import Source
from cmsreduce.model.reduced import ModalComponent
from cmsreduce.model.results.choices import BoundRecord, CutoffChoice
from cmsreduce.model.results.errors import Finding
from cmsreduce.model.results.health import HealthFinding
from cmsreduce.model.results.verdict import Proof

__all__ = [
    "AxisCompleteness",
    "ComponentResult",
    "CostlyMode",
    "CostlyModes",
    "EffectiveMassCurve",
    "Factorisation",
    "MISSING_INERTIA",
    "RoundingEffect",
]


Array = NDArray[np.float64]

MISSING_INERTIA = 0.05
"""Share of a hinge's inertia that may be lost with the modes left out: the load on its motor changes by this share."""

# Usual limit of a run on a relative change of a frequency.
_FREQUENCY = 1e-3
# Frequency of a rigid motion relative to the lowest elastic one: such a false spring moves the latter by 5e-5.
_RIGID = 1e-2


@dataclass(frozen=True)
class Factorisation:
    """A sparse factorisation done by a stage.

    Parameters
    ----------
    backend : str
        Solver.
    rows, entries : int
        Rows of the matrix, entries of a triangular factor.
    gflop, mib : float
        Operations in 1e9 and memory in MiB, from the symbolic phase.
    seconds : float
        Wall time of both phases.
    precision : str
        ``double``, or ``single`` where the factor is in float32 and its solutions are refined.
    file_mib : float
        Size of the file that holds the factor in MiB; 0 for a factor in memory.
    """

    backend: str
    rows: int
    entries: int
    gflop: float
    mib: float
    seconds: float
    precision: str = "double"
    file_mib: float = 0.0


@dataclass(frozen=True, eq=False)
class EffectiveMassCurve:
    """Running sum of the effective mass of a body's modes, with its interfaces held.

    Parameters
    ----------
    held : str
        Interfaces that are held.
    hz : (k,) float64
        Frequencies of all modes of the mode set with these interfaces held.
    running : (k, 6) float64
        Sum over the modes up to each one: share of the body's mass along x y z, and of its inertia about them.
    kept_hz, kept_running : (c,), (c, 6) float64
        The same for the modes that are kept.
    """

    held: str
    hz: Array
    running: Array
    kept_hz: Array
    kept_running: Array


@dataclass(frozen=True)
class AxisCompleteness:
    """Completeness of the modes for one articulation axis in one configuration.

    Parameters
    ----------
    axis : str
        JOINT.DOF.
    configuration : str
        Configuration of the joints.
    band : float
        Share of the inertia at the hinge that the modes in the band do not represent: 1 without any mode.
    kept : float
        The same share for all modes of the reduced model.
    whole : float
        The same share for all modes of the mode sets: the inertia of the hinge nodes themselves, and of the modes above
        the cutoff.
    locked : float
        Share of the inertia at the hinge that all modes of the reduced model represent with every hinge locked:
        0 without any mode; NaN if it was not measured.
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
        """True if the missing share is above `MISSING_INERTIA`."""
        return self.missing > MISSING_INERTIA


@dataclass(frozen=True)
class CostlyMode:
    """A mode that sets the step of an integrator without serving the band.

    Parameters
    ----------
    mode : int
        Column of the body's shapes, from 0.
    hz : float
        Frequency.
    kind : str
        Kind of basis shape with most of its kinetic energy.
    share : float
        Change of the flexibility in the band by the mass of the mode, relative to the static flexibility, at the point
        and in the direction where this is largest.
    """

    mode: int
    hz: float
    kind: str
    share: float


@dataclass(frozen=True)
class CostlyModes:
    """Modes of a body with frequencies above those of all modes that serve the band.

    Parameters
    ----------
    modes : tuple of CostlyMode
        By frequency.
    serving_hz : float
        Highest frequency of the modes that serve the band; the upper end of the band if there are none.
    factor, share : float
        A mode serves the band if its frequency is below ``factor`` times the upper end of the band, or its share is
        above ``share``.
    """

    modes: tuple[CostlyMode, ...]
    serving_hz: float
    factor: float
    share: float

    @property
    def gain(self) -> float:
        """Factor by which the step may grow if these modes are treated statically."""
        return self.modes[-1].hz / self.serving_hz if self.modes else 1.0


@dataclass(frozen=True)
class RoundingEffect:
    """Effect of single precision on a body, in modal form and in the form of a superelement.

    Parameters
    ----------
    free : float
        Largest relative change of a natural frequency with rounded modal mass and stiffness.
    held : float
        The same with every interface held, as joints hold it, and with rounded shapes at the interfaces. Infinite if a
        frequency is lost.
    rigid_hz : float
        Frequency of a rigid motion, which is 0 without rounding, if neighbours move all interfaces as one.
    boundary_free : float
        Largest relative change of a natural frequency of a superelement: mass and stiffness are rounded in interface
        dofs and fixed-interface modes. 0 for a body that cannot be one.
    boundary_rigid_hz : float
        Frequency of a rigid motion of the superelement.
    lowest_hz : float
        Lowest elastic frequency, for comparison with those of rigid motions.
    """

    free: float = 0.0
    held: float = 0.0
    rigid_hz: float = 0.0
    boundary_free: float = 0.0
    boundary_rigid_hz: float = 0.0
    lowest_hz: float = 0.0

    @property
    def modal_matters(self) -> bool:
        """True if the modal form changes by more than an engineer accepts."""
        return max(self.free, self.held) > _FREQUENCY or self.rigid_hz > _RIGID * self.lowest_hz

    @property
    def boundary_matters(self) -> bool:
        """True if the superelement changes by more than an engineer accepts."""
        return self.boundary_free > _FREQUENCY or self.boundary_rigid_hz > _RIGID * self.lowest_hz


@dataclass(frozen=True, eq=False)
class ComponentResult:
    """Findings about one flexible body.

    Parameters
    ----------
    name : str
        Name of the body.
    full_dofs : int
        Dofs of the unreduced body.
    modes : ModalComponent
        All modes of the mode set, with their ranking if there is one.
    kept : (k,) int64
        Columns of ``modes`` that the run keeps, rigid and static ones included.
    seconds : mapping of stage to float
        Wall time of each stage when it was run; a finished stage that is reused keeps its time.
    peak_mib : float
        Peak memory of the process after the stages of the body.
    checks : tuple of Finding
        Checks of the body.
    sources : tuple of Source
        Files that the body was read from.
    factorised : tuple of Factorisation
        Sparse factorisations done by its stages.
    bound : BoundRecord, optional
        Bound on the error of the body alone, if it was truncated by one.
    cutoff : CutoffChoice, optional
        Cutoff found for a body whose cutoff is ``auto``.
    scaling : str
        Scaling of its inputs and outputs for the ranking, in words; empty without a ranking.
    costly : CostlyModes, optional
        Modes that set the step of an integrator without serving the band.
    rounding : RoundingEffect, optional
        Effect of single precision on the body.
    health : tuple of HealthFinding
        Quantities measured on its matrices and its geometry before the reduction.
    proofs : tuple of Proof
        Facts that the verdict rests on: proven, trusted, unproven or refuted.
    frequency_error_bars_hz : (k,) float64
        Error bars of the elastic modes kept, in Hz, by the rounding of the body's files; empty if not computed.
    """

    name: str
    full_dofs: int
    modes: ModalComponent
    kept: NDArray[np.int64]
    seconds: Mapping[str, float]
    peak_mib: float
    checks: tuple[Finding, ...]
    sources: tuple[Source, ...]
    factorised: tuple[Factorisation, ...] = ()
    bound: BoundRecord | None = None
    cutoff: CutoffChoice | None = None
    scaling: str = ""
    costly: CostlyModes | None = None
    rounding: RoundingEffect | None = None
    health: tuple[HealthFinding, ...] = ()
    proofs: tuple[Proof, ...] = ()
    frequency_error_bars_hz: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def highest_hz(self) -> float:
        """Highest frequency of the elastic modes kept; 0 without any."""
        elastic = np.arange(self.modes.omega.size)[self.modes.elastic]
        return float(self.modes.frequencies_hz[np.intersect1d(self.kept, elastic)].max(initial=0.0))

    @property
    def kept_modes(self) -> int:
        """Elastic modes kept."""
        return int(self.kept.size - self.modes.rigid_count - self.modes.static_count)
